"""The rule ``calibrated`` once it is decided what moves: which movers move together, and what belongs to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Labels, average_linkage
from zsmoseg.grouping.costs import Costs, Sameness, pair_costs
from zsmoseg.grouping.decision import Count, Decision
from zsmoseg.grouping.evidence import Shot
from zsmoseg.grouping.instances import Nearness
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.motion.models import Floats, Model

GOES_ON = 0.5
"""Distance, in units of what is allowed, of objects that go on in each other, whatever one motion for both costs."""


@dataclass(frozen=True)
class Membership:
    """Which objects make groups, and which may join one."""

    count: Count
    """Number of groups, the static one included."""
    share: float
    """Part of the largest mover's pixels that makes a group of its own."""
    least_pairs: int
    """Pairs below which nothing is proved."""
    weak: float
    """Part of the threshold above which a hidden object may come back."""
    overlap: float
    """Part of its life up to which an object may be seen beside a mover and count as hidden by it."""


@dataclass(frozen=True)
class Members:
    """Which of N objects take part in the grouping."""

    strong: NDArray[np.bool_]
    """(N,) those that make groups."""
    open: NDArray[np.bool_]
    """(N,) those that may join one."""


def members(
    pieces: Pieces, decision: Decision, support: Floats, pairs: NDArray[np.int64], rule: Membership
) -> Members:
    """Who makes a group and who may join one.

    Strong: called moving, with ``share`` of the largest mover's pixels and ``least_pairs`` pairs or more. Open: a
    mover that is not strong; an object too short to tell; an object above ``weak`` thresholds that is mostly seen
    while no strong mover is (a hidden instance come back).

    Parameters
    ----------
    support : (N,) pixels of every object, 0 for the background.
    pairs : (N,) in which it is seen.
    """
    strong = _strong(decision, support, pairs, rule)
    if not strong.any():
        return Members(strong, strong)
    seen: NDArray[np.bool_] = np.greater(pieces.area, 0)
    covered = (seen & seen[:, strong].any(axis=1, keepdims=True)).sum(0) >= rule.overlap * seen.sum(0)
    hidden = ~covered & (decision.score > rule.weak * decision.threshold)
    unsure = decision.moving | hidden | (pairs < rule.least_pairs)
    return Members(strong, (support > 0) & ~strong & unsure)


def _strong(
    decision: Decision, support: Floats, pairs: NDArray[np.int64], rule: Membership
) -> NDArray[np.bool_]:
    """The movers that make groups; with a given number of groups at least that many, by falling evidence."""
    if rule.count == 1:
        return np.zeros(len(support), np.bool_)
    moving = decision.moving & (support > 0)
    strong: NDArray[np.bool_] = moving
    if moving.any():
        big = support >= rule.share * support[moving].max()
        strong = moving & big & (pairs >= min(rule.least_pairs, max(int(pairs.max()), 1)))
        strong = strong if strong.any() else moving
    if rule.count != "auto" and strong.sum() < rule.count - 1:
        ranked = [n for n in np.lexsort((-support, -decision.score)) if support[n] > 0 and not strong[n]]
        strong = strong.copy()
        strong[ranked[: rule.count - 1 - int(strong.sum())]] = True
    return strong


@dataclass(frozen=True)
class Facts:
    """What is known of N objects before they are grouped."""

    decision: Decision
    """Which move, and by what evidence."""
    near: Nearness
    """What is near what."""
    pairs: NDArray[np.int64]
    """(N,) pairs in which an object is seen."""
    support: Floats
    """(N,) its pixels, 0 for the background."""


def linked_groups(
    shot: Shot, chosen: Members, facts: Facts, model: Model, rule: Membership, same: Sameness
) -> Labels:
    """Groups (N,) of the movers, and what belongs to them; 0 = static.

    1. Strong objects are clustered (average linkage: Sokal, Michener, "A statistical method for evaluating
       systematic relationships", 1958) on the cost of one motion for two over what non-rigid parts of one body
       cost, less where few pairs show both; what goes on in each other counts half whatever its cost.
    2. An open object joins the nearest instance if it is near and, where they are seen together, moves with it
       rather than with the background.
    3. What joins nothing is static.
    """
    group = np.zeros(len(facts.pairs), np.int64)
    if not chosen.strong.any():
        return group
    ids = np.flatnonzero(chosen.strong | chosen.open)
    cost = pair_costs(shot, ids, len(facts.pairs), model, same)
    proof = cost.pairs / (cost.pairs + rule.least_pairs)
    apart = cost.together / cost.tolerance * np.where(cost.pairs > 0, proof, 1.0)
    ratio = np.where(facts.near.goes_on, np.minimum(apart, GOES_ON), apart)
    strong = np.flatnonzero(chosen.strong)
    clusters = None if rule.count == "auto" else min(rule.count - 1, len(strong))
    group[strong] = average_linkage(ratio[np.ix_(strong, strong)], facts.support[strong], clusters)
    _join(group, chosen.open, cost, facts, rule.least_pairs)
    return group


def _join(group: Labels, waits: NDArray[np.bool_], cost: Costs, facts: Facts, least: int) -> None:
    """Let open objects join the nearest instance, the largest first, until nothing changes."""
    near, pairs, support = facts.near.distance, facts.pairs, facts.support
    waiting = [int(n) for n in np.argsort(-support, kind="stable") if waits[n]]
    changed = True
    while changed:
        changed = False
        for n in list(waiting):
            homes = np.flatnonzero((group > 0) & (near[n] <= 1))
            short = (cost.pairs[n, homes] < least) | (pairs[n] < least)
            homes = homes[short | (cost.together[n, homes] < facts.decision.score[n])]
            if len(homes):
                group[n] = group[homes[np.lexsort((-support[homes], near[n, homes]))[0]]]
                waiting.remove(n)
                changed = True
