"""Pixel scores of masks: J (intersection over union of a frame) and Pu, Ru, Fu (tracks over a sequence)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Labels = NDArray[np.integer[Any]]
Mask = NDArray[np.bool_]


class TrackScores(NamedTuple):
    """Precision, recall and F of tracks, in percent; background is no track, surplus predictions count."""

    pu: float
    ru: float
    fu: float


def region_j(truth: Mask, prediction: Mask) -> float:
    """Intersection over union of two (H, W) masks; 1 where both are empty."""
    union = np.count_nonzero(truth | prediction)
    return np.count_nonzero(truth & prediction) / union if union else 1.0


def track_scores(pairs: Iterable[tuple[Labels, Labels]]) -> TrackScores:
    """Pu, Ru, Fu of one sequence (Dave, Tokmakov, Ramanan 2019), frame by frame.

    Parameters
    ----------
    pairs : (truth, prediction) of every annotated frame, each (H, W) of integers >= 0, 0 = background.

    Notes
    -----
    Tracks are matched one to one by the largest sum of F. The order of operations is that of the
    published evaluator, so that ties break alike.
    """
    table = np.zeros((1, 1), np.int64)
    for truth, prediction in pairs:
        rows, columns = int(truth.max(initial=0)) + 1, int(prediction.max(initial=0)) + 1
        grow = (max(rows - table.shape[0], 0), max(columns - table.shape[1], 0))
        table = np.pad(table, ((0, grow[0]), (0, grow[1])))
        code = truth.astype(np.int64).ravel() * columns + prediction.ravel()
        table[:rows, :columns] += np.bincount(code, minlength=rows * columns).reshape(rows, columns)
    truth_area, predicted_area = table.sum(1)[1:], table.sum(0)[1:]
    inter = table[1:, 1:][np.ix_(truth_area > 0, predicted_area > 0)]
    truth_area, predicted_area = truth_area[truth_area > 0], predicted_area[predicted_area > 0]
    precision, recall = inter / predicted_area, inter / truth_area[:, None]
    f = 2 * precision * recall / np.maximum(precision + recall, 1e-10)
    hit = float(inter[linear_sum_assignment(-f)].sum())
    p = 100.0 * hit / max(float(predicted_area.sum()), 1e-10)
    r = 100.0 * hit / max(float(truth_area.sum()), 1e-10)
    return TrackScores(p, r, 2 * p * r / max(p + r, 1e-10))
