"""Masks of two label images matched one to one by how much they overlap."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Ids = NDArray[np.int64]
Share = NDArray[np.float64]


def overlaps(first: NDArray[np.integer], second: NDArray[np.integer], n: int, m: int) -> tuple[Ids, Ids]:
    """Pixels that each mask of one label image shares with each of another, and that either has.

    Parameters
    ----------
    first, second
        (h, w) numbers 1 to n, and 1 to m; 0 = none.

    Returns
    -------
    intersection, union
        (n, m) each.
    """
    code = first.astype(np.int64) * (m + 1) + second
    both = np.bincount(code.ravel(), minlength=(n + 1) * (m + 1)).reshape(n + 1, -1)
    union = both.sum(1)[1:, None] + both.sum(0)[None, 1:] - both[1:, 1:]
    return both[1:, 1:], union


def matched(share: Share, least: float) -> Ids:
    """The column of each row, so that the sum of shares is the largest.

    Source: Kuhn, "The Hungarian method for the assignment problem", Naval Research Logistics Quarterly 1955.

    Parameters
    ----------
    share
        (n, m) intersection over union.
    least
        What a pair must have.

    Returns
    -------
    (n)
        Column, -1 = none.
    """
    columns = np.full(len(share), -1, np.int64)
    rows, found = scipy.optimize.linear_sum_assignment(-share)
    good = share[rows, found] >= least
    columns[rows[good]] = found[good]
    return columns
