"""Evidence that an object moves: what it costs if it must move with the static world.

    excess[n] = (SSE(world + n) - SSE(world) - SSE(n)) / |n|          px^2, joint fits

The yardstick is what pieces of the same background cost: every cell of it is measured as if it were an object.

Joint against separate fits is the F test of nested regression models (Chow, Econometrica 1960), in pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.fit import own_cost
from zsmoseg.motion.models import Floats, Model, pixels_of
from zsmoseg.motion.residuals import LEAST

LEAST_CELL = 100
"""Pixels below which a cell or the static world says nothing."""
MOST_CELL = 0.5
"""Part of the static world from which a cell is no piece of it: the rest would be the smaller."""
OFTEN = 0.2
"""Part of the pairs in which a cell must be seen to be a yardstick."""
TINY = 1e-12
"""Instead of 0 as divisor."""


@dataclass(frozen=True)
class PairGrams:
    """The Grams of one pair: the objects seen in its chunk and the cells of the background."""

    pair: int
    """Number of the pair in its shot."""
    ids: NDArray[np.int64]
    """(slots,) the objects by their number in the shot, 0 first."""
    objects: Floats
    """(slots, 11, 11)."""
    cells: Floats
    """(cells, 11, 11)."""

    @property
    def pixels(self) -> Floats:
        """(slots,)."""
        return pixels_of(self.objects)


Shot = Callable[[], Iterator[PairGrams]]
"""The valid pairs of a shot in order, as often as asked."""


@dataclass(frozen=True)
class PairEvidence:
    """What is seen in one pair; excess is a root mean square, freed of what flow noise alone would give."""

    pair: int
    """Number of the pair in its shot."""
    ids: NDArray[np.int64]
    """(n,) the objects seen."""
    excess: Floats
    """(n,) px, what each costs the static world beyond its own motion."""
    own: Floats
    """(n,) px^2, mean squared residual of its own motion."""
    pixels: Floats
    """(n,)."""
    cells: Floats
    """(cells,) px, excess of each cell; NaN where it is too small, or too large a part of the world."""


def pair_evidence(
    g: PairGrams, model: Model, static: NDArray[np.bool_], noise_area: float
) -> PairEvidence | None:
    """The evidence of one pair against the objects ``static`` (N, by global id); None where no world is seen.

    An object of the static set, and a cell, is measured against the rest of it. A fit of P parameters to n
    samples of noise variance s2 and correlation area A gains about P A s2 / n by chance, which is taken off;
    s2 is the smaller of the own residuals of the object and of the background.

    Parameters
    ----------
    noise_area : px^2, A.
    """
    inside = static[g.ids]
    world = g.objects[inside].sum(0)
    if world[0, 0] < LEAST_CELL:
        return None
    seen = np.flatnonzero(g.pixels >= LEAST)
    pixels, all_cells = g.pixels[seen], pixels_of(g.cells)
    free = np.flatnonzero((all_cells >= LEAST_CELL) & (all_cells < MOST_CELL * world[0, 0]))
    objects, cells, mine = g.objects[seen], g.cells[free], inside[seen][:, None, None]
    rest, both = np.where(mine, world - objects, world), np.where(mine, world, world + objects)
    stack = np.concatenate([objects, rest, both, cells, world - cells, world[None]])
    ends = np.cumsum([len(seen)] * 3 + [len(free)] * 2)
    own, alone, joint, cell_own, cell_rest, whole = np.split(own_cost(stack, model, g.objects.sum(0)), ends)
    of_object = _excess(joint - alone - own, pixels, pixels_of(rest))
    of_cell = np.maximum(whole[-1] - cell_own - cell_rest, 0.0) / all_cells[free]
    mean = own / pixels
    background = len(seen) and g.ids[seen[0]] == 0
    noise = float(mean[0]) if background else float(whole[-1] / world[0, 0])
    chance = model.parameters * noise_area
    found = np.full(len(g.cells), np.nan)
    found[free] = _freed(of_cell, chance * np.minimum(cell_own / all_cells[free], noise), all_cells[free])
    freed = _freed(of_object, chance * np.minimum(mean, noise), pixels)
    return PairEvidence(g.pair, g.ids[seen], freed, mean, pixels, found)


def _excess(cost: Floats, pixels: Floats, rest: Floats) -> Floats:
    """Cost per pixel of the smaller of object and world, px^2; nothing where the rest of the world is too small."""
    mean = cost / np.minimum(pixels, np.maximum(rest, 1.0))
    return np.where(rest < LEAST_CELL, 0.0, np.maximum(mean, 0.0))


def _freed(excess: Floats, gain: Floats, pixels: Floats) -> Floats:
    """Root of the excess without what noise gains by chance."""
    return np.sqrt(np.maximum(excess - gain / np.maximum(pixels, 1.0), 0.0))


@dataclass(frozen=True)
class ShotEvidence:
    """Means over the pairs of a shot."""

    pairs: list[PairEvidence]
    """Of the pairs that show a static world."""
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
    score, own = total / np.maximum(weight, TINY), left / np.maximum(weight, TINY)
    score[0] = 0.0
    if not pairs:
        return ShotEvidence([], score, own, np.zeros(0))
    cells = np.stack([e.cells for e in pairs])
    often = np.isfinite(cells).mean(0) >= OFTEN
    return ShotEvidence(pairs, score, own, np.nanmean(cells[:, often], 0) if often.any() else np.zeros(0))
