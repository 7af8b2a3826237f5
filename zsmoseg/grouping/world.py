"""What moves against the static world: the row of the world in the affinity, refitted as long as something joins it.

    E[n] = sqrt((SSE(world + n) - SSE(world) - SSE(n)) / |n| - chance)     px, what one motion for both costs
    U    = floor + sqrt(most s2(world))                                    px, more is never the world's
    T    = max(floor, E* U / (E* + U))                                     px, what is tolerated; E* of the strongest
    A[n] = mean T / (mean T + mean E) over the pairs; one half: at the tolerance

s2 is the mean square that the background's own motion leaves of its flow beyond the flow's noise: no model of a motion is
exact, and what a thing costs the world is to be seen against what the world costs alone. What the thing costs alone says
nothing: limbs and turns leave much of a mover's flow, and prove no rest. T is the harmonic sum of two bounds:
what strays less than the strongest of the pair by far is a leak of it, a shadow, or a piece of the background of another
depth; but what costs more than U moves, however strong the strongest is. The strongest itself always costs more than T.

Joint against separate fits: the F test of nested regressions (Chow, "Tests of equality between sets of coefficients in two
linear regressions", Econometrica 1960), in pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.fit import own_cost
from zsmoseg.motion.models import LEAST, Floats, Model
from zsmoseg.motion.residuals import PairResiduals

LEAST_WORLD = 100
"""Pixels below which the static world says nothing."""
LIMBS = 0.8
"""Part of what an object's own motion leaves, or of what the world's leaves if that is less, by which it is tolerated more: with
more, limbs hide a slow mover; with less, waves move (table in docs/affinity.md)."""


@dataclass(frozen=True)
class Tolerance:
    """What one motion for two may cost; px of the working grid."""

    floor: float
    """px, what is never motion: precision of the flow."""
    most: float
    """Times the mean square that the background's own motion leaves: what costs more moves, whatever else does."""
    pair: float
    """The same of two objects and both their motions, as neither is rigid: up to it they move as one."""
    noise_area: float
    """px^2 over which what a motion leaves is correlated."""
    rounds: int
    """Passes; from the second on what is static belongs to the world."""


@dataclass(frozen=True)
class Pair:
    """One pair of frames: the objects of its chunk, and how well their motions explain each other."""

    pair: int
    """Number of the pair in its shot."""
    ids: NDArray[np.int64]
    """(S,) the objects by their number in the shot, 0 first."""
    gram: Floats
    """(S, 11, 11)."""
    noise: float
    """px^2, variance of the flow's error."""
    found: PairResiduals
    """Residuals of the S objects."""

    @property
    def seen(self) -> NDArray[np.int64]:
        """The slots with enough pixels."""
        return np.flatnonzero(self.found.pixels >= LEAST)


Shot = Callable[[], Iterator[Pair]]
"""The valid pairs of a shot in order, as often as asked."""


@dataclass(frozen=True)
class Evidence:
    """What the n objects seen in one pair cost the world."""

    pair: int
    ids: NDArray[np.int64]
    """(n,) by their number in the shot, the background first."""
    excess: Floats
    """(n,) px, E."""
    tolerance: Floats
    """(n,) px, T."""
    weight: Floats
    """(n,) px, root of the pixels that count; 0 = counts for nothing."""


@dataclass(frozen=True)
class World:
    """The static world of a shot of N objects."""

    static: NDArray[np.bool_]
    """(N,) what belongs to it; the background first. What is never seen against it is not known to move."""
    evidence: list[Evidence]
    """Of the pairs that show a world, of the last pass."""


def static_world(
    shot: Shot,
    count: int,
    model: Model,
    tolerance: Tolerance,
    counts: NDArray[np.bool_],
    obeys: NDArray[np.bool_],
) -> World:
    """The world, refitted with all that agrees with it by half or more; what joins it stays.

    Parameters
    ----------
    counts : (count,) false where evidence counts for nothing, as the pictures show no motion.
    obeys : (count,) what is static by the geometry of the world: it costs the world nothing.
    """
    static = obeys | (np.arange(count) == 0)
    world = World(static, [])
    for _ in range(tolerance.rounds):
        found = [
            e for p in shot() if (e := evidence_of(p, static, model, tolerance, counts, obeys)) is not None
        ]
        joined = static | ~(_mean_agreement(found, count) < 0.5)
        world = World(joined, found)
        if np.array_equal(joined, static):
            break
        static = joined
    return world


def _mean_agreement(found: list[Evidence], count: int) -> Floats:
    """(count,) mean T over mean T + E; NaN where the weight is 0."""
    agreement, together = np.zeros((2, count))
    for e in found:
        share = shares(e.excess, e.tolerance, e.weight)
        agreement[e.ids] += share * e.tolerance
        together[e.ids] += share * (e.tolerance + e.excess)
    return np.where(together > 0, agreement / np.where(together > 0, together, 1.0), np.nan)


def shares(excess: Floats, tolerance: Floats, weight: Floats) -> Floats:
    """What a pair counts in the means of T and of E: its weight over the root of T + E.

    The root stands half way between a mean of the agreements of all pairs, in which one that shows nothing speaks as loud
    as one that shows everything, and a mean of costs, in which the fastest pair decides alone.
    """
    return weight / np.sqrt(tolerance + excess)


def deviation(p: Pair) -> Floats:
    """(n,) px^2: the mean square that the own motions of the objects seen leave beyond the flow's noise."""
    return np.maximum(p.found.own[p.seen] - p.noise, 0.0)


def evidence_of(
    p: Pair,
    static: NDArray[np.bool_],
    model: Model,
    k: Tolerance,
    counts: NDArray[np.bool_],
    obeys: NDArray[np.bool_],
) -> Evidence | None:
    """The evidence of one pair against the objects ``static`` (N,); None where no world is seen.

    An object of the static set is measured against the rest of it. A fit of P parameters to n pixels whose errors of
    variance s2 are correlated over an area a gains about P a s2 / n by chance, which is taken off; s2 is that of the
    object and the background, but no more than what the world or the background has alone.
    """
    inside, seen = static[p.ids], p.seen
    world = p.gram[inside].sum(0)
    if world[0, 0] < LEAST_WORLD or not len(seen) or seen[0] != 0:
        return None
    gram, pixels, own = p.gram[seen], p.found.pixels[seen], p.found.own[seen]
    mine = inside[seen][:, None, None]
    rest, both = np.where(mine, world - gram, world), np.where(mine, world, world + gram)
    cost = own_cost(np.concatenate([rest, both, world[None]]), model, p.gram.sum(0))
    alone, joint, whole = np.split(cost, [len(seen), 2 * len(seen)])
    left = rest[:, 0, 0]
    square = np.maximum(joint - alone - own * pixels, 0.0) / np.minimum(pixels, np.maximum(left, 1.0))
    noise = np.minimum((own[0] + own) / 2, min(float(whole[0] / world[0, 0]), own[0]))
    square = np.where(left < LEAST_WORLD, 0.0, square) - chance(noise, pixels, model, k)
    excess = np.sqrt(np.maximum(square, 0.0))
    excess[(seen == 0) | obeys[p.ids[seen]]] = 0.0
    strays = deviation(p)
    upper = k.floor + np.sqrt(k.most * (strays[0] + LIMBS * np.minimum(strays, strays[0])))
    strongest = excess[int((pixels * excess**2).argmax())]
    tolerance = np.maximum(k.floor, strongest * upper / (strongest + upper))
    weight = np.where(counts[p.ids[seen]], np.sqrt(pixels), 0.0)
    return Evidence(p.pair, p.ids[seen], excess, tolerance, weight)


def chance(noise: Floats, pixels: Floats, model: Model, k: Tolerance) -> Floats:
    """px^2 a pixel that a motion of its own gains on noise alone."""
    return np.asarray(model.parameters * k.noise_area * noise / pixels)
