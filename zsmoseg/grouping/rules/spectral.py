"""The rule ``spectral``: clusters of the affinity.

Ng, Jordan, Weiss, "On spectral clustering", NIPS 2002.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import completed
from zsmoseg.grouping.clustering import Count, Labels, agreement, spectral
from zsmoseg.motion.models import Floats

DIGITS = 9
"""Of the agreement that count: two numbers of groups that agree as well, but for rounding, are equal."""


@dataclass(frozen=True)
class Spectral:
    """How the affinity is cut."""

    equal: bool
    """Whether objects count alike, whatever their size."""
    most_groups: int
    """Most groups that ``auto`` tries."""


def spectral_groups(affinity: Floats, area: Floats, count: Count, cut: Spectral) -> Labels:
    """Row-normalised spectral clustering (Ng, Jordan, Weiss 2002); the static group is the one that holds object 0.

    Without a given number of groups the one that explains the affinity best is taken, 1 = nothing moves.

    Parameters
    ----------
    affinity : (N, N); NaN = unknown.
    area : (N,) pixels of every object, the background first.
    """
    ids, block = _seen(affinity, area)
    weight = np.ones(len(ids)) if cut.equal else np.maximum(area[ids], 1.0)
    if count == "auto":
        counts = range(1, min(cut.most_groups, len(ids)) + 1)
        tried = [(spectral(block, k, weight)[0], k) for k in counts]
        label = max(tried, key=lambda t: (round(agreement(block, t[0], weight), DIGITS), -t[1]))[0]
    else:
        label = spectral(block, min(count, len(ids)), weight)[0]
    group = np.zeros(len(area), np.int64)
    group[ids] = np.where(label == label[0], 0, label + 1)
    return group


def eigenvalues(affinity: Floats, area: Floats) -> Floats:
    """Of the normalised affinity (N, N) of the background and the objects that are seen, the largest first."""
    return spectral(_seen(affinity, area)[1], 1)[1]


def _seen(affinity: Floats, area: Floats) -> tuple[NDArray[np.int64], Floats]:
    """The background and the objects that are seen, and their affinity; what is unknown is inferred."""
    ids = np.flatnonzero((area > 0) | (np.arange(len(area)) == 0))
    return ids, completed(affinity[np.ix_(ids, ids)])
