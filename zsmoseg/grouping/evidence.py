"""Evidence that an object moves: what it costs if it must move with the static world.

    excess[n] = (SSE(world + n) - SSE(world) - SSE(n)) / |n|          px^2, joint fits

The yardstick is what pieces of the same background cost: every cell of it is measured as if it were an object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.fit import own_cost
from zsmoseg.motion.models import Floats, Model
from zsmoseg.motion.residuals import LEAST

LEAST_CELL = 100
"""Pixels below which a cell or the static world says nothing."""


@dataclass(frozen=True)
class PairGrams:
    """The Grams of one pair: the objects seen in its chunk (0 first) and the cells of the background."""

    pair: int
    ids: NDArray[np.int64]
    objects: Floats
    cells: Floats

    @property
    def pixels(self) -> Floats:
        """(slots,)."""
        return np.asarray(self.objects[:, 0, 0])


Shot = Callable[[], Iterator[PairGrams]]
"""The valid pairs of a shot in order, as often as asked."""


@dataclass(frozen=True)
class PairEvidence:
    """Root mean square excess in px of what is seen in one pair, freed of what flow noise alone would give."""

    pair: int
    ids: NDArray[np.int64]
    excess: Floats
    own: Floats
    pixels: Floats
    cells: Floats
    world_own: float


def pair_evidence(
    g: PairGrams, model: Model, static: NDArray[np.bool_], noise_area: float
) -> PairEvidence | None:
    """The evidence of one pair against the objects ``static`` (N, by global id); None where no world is seen.

    An object of the static set, and a cell, is measured against the rest of it. A fit of P parameters to n
    samples of noise variance s2 and correlation area A gains about P A s2 / n by chance, which is taken off;
    s2 is the smaller of the own residuals of the object and of the background.
    """
    pixels = g.pixels
    inside = static[g.ids]
    world = g.objects[inside].sum(0)
    if world[0, 0] < LEAST_CELL:
        return None
    frame = g.objects.sum(0)
    seen = np.flatnonzero(pixels >= LEAST)
    cell_pixels = g.cells[:, 0, 0]
    free = np.flatnonzero((cell_pixels >= LEAST_CELL) & (cell_pixels < 0.5 * world[0, 0]))
    mine = inside[seen][:, None, None]
    rest = np.where(mine, world - g.objects[seen], world)
    both = np.where(mine, world, world + g.objects[seen])
    stack = np.concatenate([g.objects[seen], rest, both, g.cells[free], world - g.cells[free], world[None]])
    cost = own_cost(stack, model, frame)
    a, b = len(seen), len(free)
    own, alone, joint = cost[:a], cost[a : 2 * a], cost[2 * a : 3 * a]
    rest_pixels = rest[:, 0, 0]
    excess = (joint - alone - own) / np.minimum(pixels[seen], np.maximum(rest_pixels, 1.0))
    excess = np.where(rest_pixels < LEAST_CELL, 0.0, np.maximum(excess, 0.0))
    cell_own, cell_rest = cost[3 * a : 3 * a + b], cost[3 * a + b : 3 * a + 2 * b]
    cell = np.maximum(cost[-1] - cell_own - cell_rest, 0.0) / cell_pixels[free]
    own_mean = own / pixels[seen]
    noise = float(own_mean[0]) if len(seen) and g.ids[seen[0]] == 0 else float(cost[-1] / world[0, 0])

    def freed(value: Floats, own_value: Floats, count: Floats) -> Floats:
        chance = model.parameters * noise_area * np.minimum(own_value, noise) / np.maximum(count, 1.0)
        return np.sqrt(np.maximum(value - chance, 0.0))

    cells = np.full(len(g.cells), np.nan)
    cells[free] = freed(cell, cell_own / cell_pixels[free], cell_pixels[free])
    return PairEvidence(
        g.pair, g.ids[seen], freed(excess, own_mean, pixels[seen]), own_mean, pixels[seen], cells, noise
    )


@dataclass(frozen=True)
class ShotEvidence:
    """Means over the pairs of a shot."""

    pairs: list[PairEvidence]
    score: Floats
    """(N,) px: mean rms excess of every object, weighted by the root of its pixels; 0 where unseen."""
    own: Floats
    """(N,) px: mean of what its own motion leaves of its flow, root mean square, weighted alike."""
    cells: Floats
    """px: mean of every cell that is seen in a fifth of the pairs or more."""


def shot_evidence(
    shot: Shot, count: int, model: Model, static: NDArray[np.bool_], noise_area: float
) -> ShotEvidence:
    """Evidence of all pairs, and its means; ``count`` objects by global id."""
    pairs = [e for g in shot() if (e := pair_evidence(g, model, static, noise_area)) is not None]
    total, left, weight = np.zeros((3, count))
    for e in pairs:
        w = np.sqrt(e.pixels)
        total[e.ids] += w * e.excess
        left[e.ids] += w * np.sqrt(e.own)
        weight[e.ids] += w
    score, own = total / np.maximum(weight, 1e-12), left / np.maximum(weight, 1e-12)
    score[0] = 0.0
    if not pairs:
        return ShotEvidence([], score, own, np.zeros(0))
    cells = np.stack([e.cells for e in pairs])
    often = np.isfinite(cells).mean(0) >= 0.2
    return ShotEvidence(pairs, score, own, np.nanmean(cells[:, often], 0) if often.any() else np.zeros(0))
