"""What each step of the embedded default's proposals is worth: scores with one step taken out at a time.

    python benchmarks/embedded_ablation.py DAVIS CACHE

DAVIS holds JPEGImages/480p and Annotations/480p; flow, superpixels and their features are kept in CACHE. Scores as in
``embedded_scores.py``: of the proposals, before the decision.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from embedded_scores import Parameters, cues, masks, scores, truth_of
from embedded_sensitivity import changed

from zsmoseg.settings import resolve

ROWS = {
    "all steps": {},
    "no path of colour from the border": {"border_colour": 1e-6},
    "no diffusion": {"spread": 0.0},
    "no colour in the links": {"link_colour": 1e6},
    "no links in time": {"link_time": 1e-6},
    "no contrast in the threshold": {"contrast_colour": 1e-6, "contrast_flow": 1e-6},
    "threshold of each frame alone": {"window": 0},
    "no persistence": {"clean_power": 0.0},
    "motion trusted without texture": {"trust_least": 1.0},
    "motion counts unseen": {"show_detail": 1e12},
    "superpixels 11.5 px apart": {"pitch": 11.5},
    "binary map not filtered": {"guide_eps": 1e3, "guide_radius": 1},
}
"""Settings and constants that take one step out."""


def main() -> None:
    """Print the table."""
    davis, cache = map(Path, sys.argv[1:])
    cv2.setNumThreads(1)
    images = davis / "JPEGImages/480p"
    names = sorted(path.name for path in images.iterdir())
    truths = {name: truth_of(davis / "Annotations/480p" / name) for name in names}
    print(f"{'means of ' + str(len(names)):<34} {'J':>6} {'Fu':>6} {'Pu':>6} {'Ru':>6}   largest change of J")
    reference: dict[str, float] = {}
    for title, changes in ROWS.items():
        p = changed(Parameters.of(resolve()), changes)
        rows = {n: scores(masks(cues(images / n, p, cache), p)[0] > 0, truths[n]) for n in names}
        reference = reference or {name: row[0] for name, row in rows.items()}
        change = {name: row[0] - reference[name] for name, row in rows.items()}
        worst = max(change, key=lambda name: abs(change[name]))
        mean = " ".join(f"{value:6.1f}" for value in np.mean(list(rows.values()), 0))
        print(f"{title:<34} {mean}   {worst} {change[worst]:+.1f}", flush=True)


if __name__ == "__main__":
    main()
