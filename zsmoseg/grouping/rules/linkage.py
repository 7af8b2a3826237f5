"""The rule ``linkage``: what does not agree with the world moves, and movers that agree with each other move together.

Average linkage: Sokal, Michener, "A statistical method for evaluating systematic relationships", 1958.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import ShotAffinity
from zsmoseg.grouping.clustering import Count, Labels, average_linkage
from zsmoseg.grouping.instances import Nearness
from zsmoseg.motion.models import Floats

GOES_ON = 0.5
"""Distance, in units of what is allowed, of objects that go on in each other, whatever one motion for both costs."""
TINY = 1e-9
"""Affinity that a distance is taken of at least."""


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
    """Odds against the world above which a hidden object may come back."""
    overlap: float
    """Part of its life up to which an object may be seen beside a mover and count as hidden by it."""


@dataclass(frozen=True)
class Members:
    """Which of N objects take part in the grouping."""

    strong: NDArray[np.bool_]
    """(N,) those that make groups."""
    open: NDArray[np.bool_]
    """(N,) those that may join one."""


def odds(affinity: Floats) -> Floats:
    """Odds against one motion, 1 / A - 1, in any shape: 1 = at the tolerance; unknown stays NaN."""
    return 1.0 / np.maximum(affinity, TINY) - 1.0


def members(found: ShotAffinity, seen: NDArray[np.bool_], support: Floats, rule: Membership) -> Members:
    """Who makes a group and who may join one.

    Strong: not of the static world, with ``share`` of the largest mover's pixels and ``least_pairs`` pairs or more.
    Open: a mover that is not strong; an object too short to tell; an object of ``weak`` odds against the world that is
    mostly seen while no strong mover is (a hidden instance come back).

    Parameters
    ----------
    seen : (T, N) whether a frame shows an object.
    support : (N,) pixels of every object, 0 for the background.
    """
    pairs, against = np.diagonal(found.pairs), odds(found.affinity[0])
    moving = ~found.static & (support > 0)
    strong = _strong(moving, against, support, pairs, rule)
    if not strong.any():
        return Members(strong, strong)
    covered = (seen & seen[:, strong].any(axis=1, keepdims=True)).sum(0) >= rule.overlap * seen.sum(0)
    unsure = moving | (~covered & (against > rule.weak)) | (pairs < rule.least_pairs)
    return Members(strong, (support > 0) & ~strong & unsure)


def _strong(
    moving: NDArray[np.bool_], against: Floats, support: Floats, pairs: NDArray[np.int64], rule: Membership
) -> NDArray[np.bool_]:
    """The movers that make groups; with a given number of groups at least that many, by falling odds."""
    if rule.count == 1:
        return np.zeros(len(support), np.bool_)
    strong = moving
    if moving.any():
        big = support >= rule.share * support[moving].max()
        strong = moving & big & (pairs >= min(rule.least_pairs, max(int(pairs.max()), 1)))
        strong = strong if strong.any() else moving
    if rule.count != "auto" and strong.sum() < rule.count - 1:
        known = np.where(np.isfinite(against), against, -1.0)
        ranked = [n for n in np.lexsort((-support, -known)) if support[n] > 0 and not strong[n]]
        strong = strong.copy()
        strong[ranked[: rule.count - 1 - int(strong.sum())]] = True
    return strong


def linked_groups(
    found: ShotAffinity, chosen: Members, near: Nearness, support: Floats, rule: Membership
) -> Labels:
    """Groups (N,) of the movers, and what belongs to them; 0 = static.

    1. Strong objects are clustered by average linkage while the mean odds against one motion are at most 1; less where
       few pairs show both; what goes on in each other counts half whatever its odds.
    2. An open object joins the nearest instance if it is near and, where they are seen together, agrees with it more
       than with the world.
    3. What joins nothing is static.

    Parameters
    ----------
    near : what is near what.
    support : (N,) pixels of every object, 0 for the background.
    """
    group = np.zeros(len(support), np.int64)
    strong = np.flatnonzero(chosen.strong)
    if len(strong):
        proof = found.pairs / (found.pairs + rule.least_pairs)
        apart = odds(found.affinity) * np.where(found.pairs > 0, proof, 1.0)
        distance = np.where(near.goes_on, np.fmin(apart, GOES_ON), apart)
        clusters = None if rule.count == "auto" else min(rule.count - 1, len(strong))
        group[strong] = average_linkage(distance[np.ix_(strong, strong)], support[strong], clusters)
        _join(group, chosen.open, found, near, support, rule.least_pairs)
    return group


def _join(
    group: Labels,
    waits: NDArray[np.bool_],
    found: ShotAffinity,
    near: Nearness,
    support: Floats,
    least: int,
) -> None:
    """Let open objects join the nearest instance, the largest first, until nothing changes."""
    distance, pairs = near.distance, found.pairs
    waiting = [int(n) for n in np.argsort(-support, kind="stable") if waits[n]]
    changed = True
    while changed:
        changed = False
        for n in list(waiting):
            homes = np.flatnonzero((group > 0) & (distance[n] <= 1))
            short = (pairs[n, homes] < least) | (pairs[n, n] < least)
            homes = homes[short | (odds(found.affinity[n, homes]) < odds(found.affinity[0, n]))]
            if len(homes):
                group[n] = group[homes[np.lexsort((-support[homes], distance[n, homes]))[0]]]
                waiting.remove(n)
                changed = True
