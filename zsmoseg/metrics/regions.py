"""Region similarity J: intersection over union of two masks of one frame.

Intersection over union: Jaccard 1912; as a region measure of videos: Perazzi et al., CVPR 2016.
"""

from __future__ import annotations

import numpy as np

from zsmoseg.metrics.counts import Mask, PairCounts


def region_j(truth: Mask, prediction: Mask, void: Mask | None = None) -> float:
    """Intersection over union of two (H, W) masks outside ``void``; 1 where both are empty."""
    if void is not None:
        truth, prediction = truth & ~void, prediction & ~void
    union = np.count_nonzero(truth | prediction)
    return np.count_nonzero(truth & prediction) / union if union else 1.0


def merged_j(counts: PairCounts) -> float:
    """J of everything that is not 0, from the pair counts of one frame."""
    truth, prediction = counts.truth != 0, counts.prediction != 0
    union = counts.pixels[truth | prediction].sum()
    return float(counts.pixels[truth & prediction].sum() / union) if union else 1.0


def object_j(counts: PairCounts, truth: int, prediction: int) -> float:
    """J of one true and one predicted label, from the pair counts of one frame."""
    mine, other = counts.truth == truth, counts.prediction == prediction
    union = counts.pixels[mine | other].sum()
    return float(counts.pixels[mine & other].sum() / union) if union else 1.0
