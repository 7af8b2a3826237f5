"""Scores of labelled track points (KT3DMoSeg, Hopkins155)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Labels = NDArray[np.integer[Any]]


def classification_error(truth: Labels, prediction: Labels) -> float:
    """Points in the wrong group, in percent, under the one-to-one assignment of groups with the fewest.

    The background is a group like any other. Points of a predicted group beyond the number of true ones are wrong.

    Parameters
    ----------
    truth, prediction : (N,) group of each point, any integers; N at least 1.

    Examples
    --------
    >>> classification_error(np.array([1, 1, 1, 2]), np.array([7, 7, 5, 5]))
    25.0
    """
    if truth.shape != prediction.shape or truth.ndim != 1 or not truth.size:
        raise ValueError(f"labels of the same points expected, not of {truth.shape} and {prediction.shape}")
    true_ids, rows = np.unique(truth, return_inverse=True)
    predicted_ids, columns = np.unique(prediction, return_inverse=True)
    table = np.zeros((len(true_ids), len(predicted_ids)), np.int64)
    np.add.at(table, (rows, columns), 1)
    right = int(table[linear_sum_assignment(-table)].sum())
    return 100.0 * (truth.size - right) / truth.size
