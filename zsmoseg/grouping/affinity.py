"""The affinity of all objects of a shot, summed over its pairs and normalised by those in which both are seen."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.kernels import inlier, ordered, ordered_weighted
from zsmoseg.motion.models import Floats

UNKNOWN = 0.5
"""Affinity of objects that are never seen together and have no neighbour in common."""


def accumulate(
    pairs: Iterable[tuple[NDArray[np.int64], Floats, Floats]], count: int, s: settings.Affinity
) -> tuple[Floats, Floats]:
    """Agreement and togetherness (count, count), summed over pairs in their order.

    Parameters
    ----------
    pairs : per pair the objects (slots,), residuals (slots, slots) with NaN where unseen, pixels (slots,).
    """
    agreement, together = np.zeros((count, count)), np.zeros((count, count))
    for ids, residual, pixels in pairs:
        seen = np.flatnonzero(np.isfinite(np.diagonal(residual)))
        if not len(seen):
            continue
        at, block, size = np.ix_(ids[seen], ids[seen]), residual[np.ix_(seen, seen)], pixels[seen]
        weight = np.ones_like(block)
        if s.weight == "area":
            weight = np.sqrt(np.minimum(size[:, None], size[None, :]))
        if s.kernel == "inlier":
            kernel = inlier(block, size, s.factor, s.floor)
        elif s.kernel == "ordered-weighted":
            kernel = ordered_weighted(block, s.ranking)
        else:
            kernel = ordered(block, s.share, s.ranking)
        agreement[at] += weight * kernel
        together[at] += weight
    return agreement, together


def normalised(agreement: Floats, together: Floats) -> Floats:
    """Affinity (N, N): agreement over togetherness.

    Together = 0 means unknown, not different: such a pair gets the best product of affinities over a common
    neighbour, and ``UNKNOWN`` where there is none.
    """
    known = together > 0
    measured = np.where(known, agreement / np.where(known, together, 1.0), 0.0)
    affinity = measured.copy()
    for i in np.flatnonzero((~known).any(1)):
        products = np.where(known[i][None, :] & known, measured[i][None, :] * measured, -1.0)
        best = products.max(1)
        unknown = ~known[i]
        affinity[i, unknown] = np.where(best >= 0, best, UNKNOWN)[unknown]
    return (affinity + affinity.T) / 2
