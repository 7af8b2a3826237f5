"""Score the masks of ``zsmoseg run`` against DAVIS annotations.

    zsmoseg run DAVIS/JPEGImages/480p -o OUT
    python benchmarks/davis_scores.py OUT DAVIS/Annotations/480p

J: mean over the frames but the first and the last. Pu, Ru, Fu: over all pixels of the sequence. All
moving groups count as foreground. Percent.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from zsmoseg.metrics.regions import region_j
from zsmoseg.metrics.tracks import track_scores

PAIR = ("kite-surf", "paragliding-launch")


def mask(path: Path) -> np.ndarray:
    """Foreground of an indexed or grey image."""
    return np.asarray(Image.open(path)) > 0


def score(out: Path, truth: Path) -> list[float]:
    """J, Pu, Ru, Fu, groups and moving objects of one sequence."""
    pairs = [(mask(p), mask(out / "masks" / p.name)) for p in sorted(truth.glob("*.png"))]
    j = 100 * float(np.mean([region_j(t, p) for t, p in pairs[1:-1]]))
    scores = track_scores((t.astype(int), p.astype(int)) for t, p in pairs)
    summary = json.loads((out / "summary.json").read_text())
    objects = {e["object"] for e in summary["evidence"] if e["group"]}
    return [j, scores.pu, scores.ru, scores.fu, summary["groups"], len(objects)]


def main() -> None:
    """Print the table."""
    out, annotations = Path(sys.argv[1]), Path(sys.argv[2])
    rows = {p.name: score(out / p.name, p) for p in sorted(annotations.iterdir()) if (out / p.name).is_dir()}
    print(f"{'sequence':<20} {'J':>6} {'Pu':>6} {'Ru':>6} {'Fu':>6} groups objects")
    for name, row in rows.items():
        print(f"{name:<20} " + " ".join(f"{v:6.1f}" for v in row[:4]) + f" {row[4]:6d} {row[5]:6d}")
    subsets = {"mean": list(rows), "mean without " + " ".join(PAIR): [n for n in rows if n not in PAIR]}
    for title, names in subsets.items():
        means = np.mean([rows[n][:4] for n in names], axis=0)
        print(
            f"{title} ({len(names)}): "
            + " ".join(f"{k} {v:.1f}" for k, v in zip(("J", "Pu", "Ru", "Fu"), means, strict=True))
        )
    two = sum(row[4] == 2 for row in rows.values())
    print(f"two groups (static and one moving): {two} of {len(rows)}")


if __name__ == "__main__":
    main()
