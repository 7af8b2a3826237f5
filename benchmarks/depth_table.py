"""Pseudo depth and motion models on DAVIS: what each combination scores behind the same proposals.

    python benchmarks/depth_table.py DAVIS/JPEGImages/480p DAVIS/Annotations/480p STORE

Flow, segments and labels are computed once and kept in STORE.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from davis_scores import score

from zsmoseg.settings import resolve
from zsmoseg.workflows.run import Request, run

COMBINATIONS = [
    *(("constant", model) for model in ("affine", "quadratic", "planar", "screw-shift")),
    *(("ground", model) for model in ("screw", "screw-shift", "screw-plane", "screw-printed")),
]


def main() -> None:
    """Print the table."""
    frames, truth, store = map(Path, sys.argv[1:4])
    print(f"{'depth':<10} {'model':<14} {'J':>6} {'Fu':>6}  two groups")
    for source, model in COMBINATIONS:
        settings = {"depth.source": source, "motion.model": model, "overlay.write": False}
        out = store.parent / f"{source}-{model}"
        run(Request([str(frames)], out, store, resolve(overrides=settings), "local"))
        rows = np.array([score(out / p.name, p) for p in sorted(truth.iterdir()) if (out / p.name).is_dir()])
        two = int((rows[:, 4] == 2).sum())
        print(
            f"{source:<10} {model:<14} {rows[:, 0].mean():6.1f} {rows[:, 3].mean():6.1f}  {two} of {len(rows)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
