"""The affinity of all objects of a shot, summed over its pairs and normalised by those in which both are seen.

Normalised by the pairs in which both are seen: Huang, Chen, Zelek (the paper), section on the affinity.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.kernels import inlier, ordered, ordered_weighted
from zsmoseg.motion.models import Floats

UNKNOWN = 0.5
"""Affinity of objects that are never seen together and have no neighbour in common: as like as unlike."""


@dataclass(frozen=True)
class Kernel:
    """How residuals of a pair become agreement, and what the pair counts."""

    kernel: Literal["inlier", "ordered", "ordered-weighted"]
    """The kernel, see ``zsmoseg.grouping.kernels``."""
    factor: float
    """Of ``inlier``: residual over own residual up to which a model fits."""
    floor: float
    """Of ``inlier``: px, residual that is noise."""
    share: float
    """Of ``ordered``: part of the objects that each chooses."""
    ranking: Literal["row", "column"]
    """Of both ordered ones: whether models rank objects or objects models."""
    weight: Literal["area", "equal"]
    """Whether pairs count by the root of the smaller area, or all alike."""


def accumulate(
    pairs: Iterable[tuple[NDArray[np.int64], Floats, Floats]], count: int, parameters: Kernel
) -> tuple[Floats, Floats]:
    """Agreement and togetherness (count, count), summed over pairs in their order.

    Parameters
    ----------
    pairs : per pair the objects (slots,), residuals (slots, slots) with NaN where unseen, pixels (slots,).
    count : objects.
    """
    agreement, together = np.zeros((count, count)), np.zeros((count, count))
    for ids, residual, pixels in pairs:
        seen = np.flatnonzero(np.isfinite(np.diagonal(residual)))
        if not len(seen):
            continue
        at, block, size = np.ix_(ids[seen], ids[seen]), residual[np.ix_(seen, seen)], pixels[seen]
        weight = np.ones_like(block)
        if parameters.weight == "area":
            weight = np.sqrt(np.minimum(size[:, None], size[None, :]))
        agreement[at] += weight * _agreement(block, size, parameters)
        together[at] += weight
    return agreement, together


def _agreement(residual: Floats, pixels: Floats, parameters: Kernel) -> Floats:
    """(n, n) who agrees with whom in one pair, of the n objects seen."""
    if parameters.kernel == "inlier":
        return inlier(residual, pixels, parameters.factor, parameters.floor)
    if parameters.kernel == "ordered-weighted":
        return ordered_weighted(residual, parameters.ranking)
    return ordered(residual, parameters.share, parameters.ranking)


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
