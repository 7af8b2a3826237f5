"""The groups of a shot: what moves, which movers move together, which objects are one instance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import ShotAffinity
from zsmoseg.grouping.clustering import Count, Labels
from zsmoseg.grouping.decisions import Reason, reasons_of_kept, reasons_of_linkage
from zsmoseg.grouping.instances import Joining, Nearness, movers_torn_from, nearness
from zsmoseg.grouping.numbering import connected, renumbered
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.grouping.remarks import remarks
from zsmoseg.grouping.rules.kept import kept_groups
from zsmoseg.grouping.rules.linkage import Membership, linked_groups, members
from zsmoseg.grouping.rules.spectral import Spectral, eigenvalues, spectral_groups
from zsmoseg.grouping.state import Hysteresis, motion_state
from zsmoseg.grouping.world import shares
from zsmoseg.motion.models import Floats


@dataclass(frozen=True)
class Grouping:
    """How objects are grouped: the rule, and the numbers of every part of it."""

    rule: Literal["linkage", "spectral", "keep"]
    """linkage: what agrees with the world is static, the rest by average linkage; spectral: clusters of the affinity;
    keep: all move, each by itself."""
    count: Count
    """Number of groups, the static one included, or ``auto``."""
    membership: Membership
    """Which movers make groups, and who may join one."""
    joining: Joining
    """What may lie between two objects that are one instance."""
    spectral: Spectral
    """How the affinity is cut."""
    hysteresis: Hysteresis
    """When a mover rests."""


@dataclass(frozen=True)
class ShotGroups:
    """The answer for the N objects of a shot of T frames, object 0 first."""

    group: Labels
    """(N,) 0 = static, 1.. by falling size."""
    instance: Labels
    """(N,) the largest object of the instance that it belongs to; 0 = static."""
    moving: NDArray[np.bool_]
    """(T, N) whether an object moves at a frame; what was torn off a mover moves when that does."""
    margin: NDArray[np.float32]
    """(T, N) ln of its own odds against the static world, NaN = unknown."""
    excess: Floats
    """(N,) px, what one motion for an object and the static world costs, mean over the pairs; NaN = unknown."""
    tolerance: Floats
    """(N,) px, what of it is tolerated; tolerance / (tolerance + excess) is the affinity with the world."""
    eigenvalues: Floats
    """Of the normalised affinity of the objects that are seen, the largest first."""
    reason: Labels
    """(N,) what decided, a ``Reason``."""
    warnings: list[str] = field(default_factory=list)


def group_shot(
    found: ShotAffinity,
    pieces: Pieces,
    velocity: Floats,
    whole: Labels,
    shape: tuple[int, int],
    grouping: Grouping,
) -> ShotGroups:
    """Group, link, tell when.

    Parameters
    ----------
    found : the affinity of the N objects, and the evidence beside it.
    pieces : place and colour of the objects.
    velocity : (2, N, 2) px a frame, of the first and of the last pairs of every object.
    whole : (N,) what the proposals hold together, see ``instances.movers_torn_from``.
    shape : height and width of the working grid.
    """
    area, seen = pieces.area.sum(0).astype(np.float64), np.greater(pieces.area, 0)
    support = np.append(0.0, area[1:])
    excess, tolerance = means_against_world(found)
    world, home = tolerance / (tolerance + excess), np.arange(len(whole))

    def near_to(wanted: NDArray[np.bool_]) -> Nearness:
        return nearness(pieces, velocity, shape, np.flatnonzero(wanted), grouping.joining)

    if grouping.rule == "linkage":
        chosen = members(found, seen, support, grouping.membership)
        near = near_to(chosen.strong | chosen.open)
        group = linked_groups(found, chosen, near, support, grouping.membership)
        home = movers_torn_from(group, whole, found.affinity, support)
        torn = home != np.arange(len(home))
        reason = reasons_of_linkage(found, chosen, group[home], torn, world, grouping.membership)
    elif grouping.rule == "spectral":
        group = spectral_groups(found.affinity, area, grouping.count, grouping.spectral)
        near, reason = near_to(group > 0), np.full_like(group, Reason.CLUSTERS)
    else:
        group = kept_groups(support, grouping.count)
        near, reason = near_to(group > 0), reasons_of_kept(group, grouping.count)
    # before what was torn off goes back: it joins one instance, and joins no two
    instance = connected(group, near.distance <= 1, support)[home]
    group = renumbered(group[home], support)
    by_pair, against = found.excess / found.tolerance, excess / tolerance
    moving, margin = motion_state(by_pair, against, group, len(pieces.area), grouping.hysteresis)
    return ShotGroups(
        group,
        instance,
        moving[:, home] & seen,
        margin,
        excess,
        tolerance,
        eigenvalues(found.affinity, area),
        reason,
        list(remarks(seen[:, 1:], group, grouping.count, bool(np.isfinite(found.excess).any()))),
    )


def means_against_world(found: ShotAffinity) -> tuple[Floats, Floats]:
    """Excess and tolerance (N,) px against the static world, whatever the kernel; NaN = counts for nothing."""
    seen = np.isfinite(found.excess) & (found.weight > 0)
    excess, tolerance = np.where(seen, found.excess, 0.0), np.where(seen, found.tolerance, 1.0)
    share = np.where(seen, shares(excess, tolerance, found.weight), 0.0)
    total = share.sum(0)
    total = np.where(total > 0, total, np.nan)
    return (share * excess).sum(0) / total, (share * tolerance).sum(0) / total
