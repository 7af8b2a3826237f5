"""What decided that an object moves or not: what it costs the static world, or what overrode that."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import ShotAffinity
from zsmoseg.grouping.clustering import Count, Labels
from zsmoseg.grouping.rules.linkage import Members, Membership
from zsmoseg.motion.models import Floats

BORDER = 0.5
"""Affinity with the static world below which an object moves."""


class Reason(IntEnum):
    """Why an object moves or does not."""

    EVIDENCE = 0
    """Its affinity with the world, from excess and tolerance: below the border it moves."""
    UNKNOWN = 1
    """Nothing is known of it against the world: static."""
    JOINED = 2
    """It is near an object that moves, and belongs to it."""
    COUNT = 3
    """The number of groups that was asked for."""
    SMALL = 4
    """It moves, but is too small beside the largest mover for a group of its own, and near to none: static."""
    SHORT = 5
    """It moves, but in too few pairs of frames to prove it, and is near to none: static."""
    REFITTED = 6
    """It agreed with the world before others were counted to that, and what joins the world stays: static."""
    CUES = 7
    """The affinity of the kernel and the cues that were chosen, which says otherwise."""
    CLUSTERS = 8
    """The clusters of the affinity (``spectral``)."""
    KEPT = 9
    """It is kept as it was proposed (``keep``)."""
    TORN = 10
    """It is held together with a larger object that moves, and does not move apart from the world by itself: a limb of it."""


def reasons_of_linkage(
    found: ShotAffinity,
    chosen: Members,
    group: Labels,
    torn: NDArray[np.bool_],
    world: Floats,
    rule: Membership,
) -> Labels:
    """The reason (N,) for the group of every object by the rule ``linkage``.

    Parameters
    ----------
    group : (N,) 0 = static.
    torn : (N,) what went back to the mover that it was torn off.
    world : (N,) affinity with the world by what it costs, NaN = unknown.
    """
    costs, alike = world < BORDER, found.affinity[0] >= BORDER
    cases: list[tuple[NDArray[np.bool_], Reason]] = [
        (torn, Reason.TORN),
        ((group > 0) & chosen.open, Reason.JOINED),
        ((group > 0) & found.static, Reason.COUNT),
        (group > 0, Reason.CUES),
        (found.static & ~np.isfinite(world), Reason.UNKNOWN),
        (found.static & costs & alike, Reason.CUES),
        (found.static & costs, Reason.REFITTED),
        (found.static, Reason.EVIDENCE),
        (np.full(len(group), rule.count == 1), Reason.COUNT),
        (np.diagonal(found.pairs) < rule.least_pairs, Reason.SHORT),
    ]
    overridden = np.select([case for case, _ in cases], [reason for _, reason in cases], Reason.SMALL)
    proved = (group > 0) & ~torn & ~chosen.open & ~found.static & costs
    return np.where(proved, Reason.EVIDENCE, overridden).astype(np.int64)


def reasons_of_kept(group: Labels, count: Count) -> Labels:
    """The same by the rule ``keep``."""
    left_out = (group == 0) & (count != "auto")
    return np.where(left_out, Reason.COUNT, Reason.KEPT).astype(np.int64)
