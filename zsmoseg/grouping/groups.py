"""The groups of a shot: what moves, which movers move together, which objects are one instance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Labels
from zsmoseg.grouping.costs import Sameness
from zsmoseg.grouping.decision import Count, Decision, Thresholds, decide
from zsmoseg.grouping.evidence import Shot
from zsmoseg.grouping.instances import Joining, Nearness, nearness
from zsmoseg.grouping.numbering import connected, renumbered
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.grouping.remarks import remarks
from zsmoseg.grouping.rules.kept import kept_groups
from zsmoseg.grouping.rules.linked import Facts, Membership, linked_groups, members
from zsmoseg.grouping.rules.spectral import Spectral, eigenvalues, spectral_groups
from zsmoseg.grouping.sightings import Sightings, sightings
from zsmoseg.grouping.state import Hysteresis, motion_state
from zsmoseg.motion.models import MODELS, Floats, Model

LEAST = 1e-6
"""px that a threshold is at least."""


@dataclass(frozen=True)
class Grouping:
    """How objects are grouped: the rule, and the numbers of every part of it."""

    rule: Literal["calibrated", "spectral", "keep"]
    """calibrated: evidence against the background's own cells; spectral: clusters of the affinity; keep: all move."""
    count: Count
    """Number of groups, the static one included, or ``auto``."""
    visible: float
    """Image error of the world's motion over that of the flow below which nothing visibly moves."""
    thresholds: Thresholds
    """Which objects move."""
    membership: Membership
    """Which movers make groups, and who may join one."""
    sameness: Sameness
    """What one motion for two may cost."""
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
    """(N,) 0 = static, 1.. by falling size."""
    moving: NDArray[np.bool_]
    """(T, N) whether an object moves at a frame."""
    margin: NDArray[np.float32]
    """(T, N) ln(excess / threshold), NaN = unknown."""
    decision: Decision
    eigenvalues: Floats
    """Of the normalised affinity of the objects that are seen, the largest first."""
    warnings: list[str] = field(default_factory=list)


def group_shot(
    shot: Shot,
    pieces: Pieces,
    affinity: Floats,
    shape: tuple[int, int],
    model: str,
    grouping: Grouping,
    visibility: Floats | None = None,
) -> ShotGroups:
    """Decide, group, link.

    Parameters
    ----------
    shot : the Grams of the valid pairs.
    pieces : place and colour of the N objects.
    affinity : (N, N), used by the rule ``spectral``.
    shape : height and width of the working grid.
    model : name of the motion model.
    visibility : (N,) what the world's motion leaves unexplained of an object's pixels over what its flow does;
        None: there are no pictures.
    """
    area = pieces.area.sum(0).astype(np.float64)
    support = np.append(0.0, area[1:])
    visible = None if visibility is None else visibility >= grouping.visible
    decision = decide(shot, area, MODELS[model], grouping.thresholds, visible)
    seen = sightings(shot, len(area))
    if grouping.rule == "calibrated":
        group, near = _calibrated(shot, pieces, decision, seen, support, shape, MODELS[model], grouping)
    else:
        count, cut = grouping.count, grouping.spectral
        by_affinity = grouping.rule == "spectral"
        group = spectral_groups(affinity, area, count, cut) if by_affinity else kept_groups(support, count)
        near = nearness(pieces, seen.velocity, shape, np.flatnonzero(group > 0), grouping.joining)
    group = renumbered(group, support)
    threshold = _thresholds(decision, group, grouping.thresholds.below_strongest)
    frames = len(pieces.area)
    moving, margin = motion_state(decision.evidence.pairs, frames, group, threshold, grouping.hysteresis)
    return ShotGroups(
        group,
        connected(group, near.distance <= 1, support),
        moving & (pieces.area > 0),
        margin,
        decision,
        eigenvalues(affinity, area),
        remarks(pieces.area[:, 1:] > 0, group, grouping.count, inferred=grouping.rule == "spectral"),
    )


def _calibrated(
    shot: Shot,
    pieces: Pieces,
    decision: Decision,
    seen: Sightings,
    support: Floats,
    shape: tuple[int, int],
    model: Model,
    grouping: Grouping,
) -> tuple[Labels, Nearness]:
    """The groups of the default rule (N,), and what is near what."""
    chosen = members(pieces, decision, support, seen.pairs, grouping.membership)
    wanted = np.flatnonzero(chosen.strong | chosen.open)
    near = nearness(pieces, seen.velocity, shape, wanted, grouping.joining)
    facts = Facts(decision, near, seen.pairs, support)
    return linked_groups(shot, chosen, facts, model, grouping.membership, grouping.sameness), near


def _thresholds(decision: Decision, group: Labels, part: float) -> Floats:
    """(N,) px above which an object moves at a pair.

    The decision's; what moves by other evidence (a given number of groups, another rule, a piece of an instance)
    is held to ``part`` of its own mean.
    """
    out = decision.threshold.copy()
    movers = group > 0
    out[movers] = np.minimum(out[movers], part * decision.score[movers])
    return np.asarray(np.maximum(out, LEAST), np.float64)
