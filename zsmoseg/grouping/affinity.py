"""The affinity of all objects of a shot: kernels of its pairs, summed and normalised by those in which both are seen.

Normalised by the pairs in which both are seen: Huang, Chen, Zelek (the paper), section on the affinity. Of the kernel
``merge`` it is mean T / (mean T + mean E), of what is tolerated and what one motion for both costs: 1 = one motion, one
half = at the tolerance. Object 0 is the background, its row the static world's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.fusion import fused
from zsmoseg.grouping.geometry import Geometry
from zsmoseg.grouping.kernels import geometric, merge, ordered, ordered_weighted
from zsmoseg.grouping.world import Evidence, Pair, Shot, Tolerance, World, shares, static_world
from zsmoseg.motion.models import Floats, Model

UNKNOWN = 0.5
"""Affinity of objects that are never seen together and have no neighbour in common: as like as unlike."""
TINY = 1e-12
"""Instead of 0 as divisor."""

Agreement = tuple[NDArray[np.int64], Floats, Floats]
"""Of one pair: the n objects seen by their number in the shot, who agrees with whom (n, n), and what it counts (n, n)."""
Views = Iterable[tuple[NDArray[np.int64], Floats, Floats]]
"""Per pair of frames the objects (n,), squared residuals (n, n) of their models on each other, points (n,)."""


@dataclass(frozen=True)
class Kernel:
    """How residuals of a pair become agreement, and what the pair counts."""

    kernel: Literal["merge", "ordered", "ordered-weighted"]
    """The kernel, see ``zsmoseg.grouping.kernels``."""
    share: float
    """Of ``ordered``: part of the objects that each chooses."""
    ranking: Literal["row", "column"]
    """Of both ordered ones: whether models rank objects or objects models."""
    weight: Literal["area", "equal"]
    """Whether pairs count by the root of the smaller area, or all alike."""
    cues: Literal["flow", "epipolar", "both"]
    """Residuals of the motion of flow, of two-view geometry, or both."""
    fusion: Literal["sum", "coregularised"]
    """How two affinities become one."""
    columns: int
    """Of ``coregularised``: eigenvectors of each affinity."""
    visible: float
    """Image error of the world's motion over that of the flow below which nothing visibly moves."""
    tolerance: Tolerance
    """What one motion for two may cost."""


@dataclass(frozen=True)
class ShotAffinity:
    """The affinity of the N objects of a shot with M pairs of frames, and what lies beside it."""

    affinity: Floats
    """(N, N) 0 to 1; NaN = unknown, the two are never seen together."""
    agreement: Floats
    """(cues, N, N) kernel, summed over pairs of frames with its weight."""
    together: Floats
    """(cues, N, N) the weight."""
    pairs: NDArray[np.int64]
    """(N, N) pairs of frames in which both are seen."""
    static: NDArray[np.bool_]
    """(N,) what belongs to the static world."""
    excess: Floats
    """(M, N) px, what one motion for an object and the world costs; NaN = unseen."""
    tolerance: Floats
    """(M, N) px, what of it is tolerated; NaN = unseen."""
    weight: Floats
    """(M, N) what an object counts against the world; 0 = for nothing."""


def shot_affinity(
    shot: Shot,
    size: tuple[int, int],
    model: Model,
    kernel: Kernel,
    visibility: Floats | None = None,
    views: Views = (),
    geometry: Geometry | None = None,
) -> ShotAffinity:
    """The affinity of one shot.

    Parameters
    ----------
    shot : its valid pairs.
    size : pairs of frames M and objects N.
    visibility : (N,) what the world's motion leaves unexplained of an object's pixels over what its flow does; None:
        there are no pictures.
    views : residuals of two-view geometry, for ``kernel.cues`` other than flow.
    geometry : what obeys it has affinity 1 with the world; None: nothing is known of it.
    """
    count = size[1]
    geometry = geometry or Geometry.unasked(count)
    counts = np.ones(count, np.bool_) if visibility is None else visibility >= kernel.visible
    counts = (counts & geometry.counts) | geometry.obeys | (np.arange(count) == 0)
    world = static_world(shot, count, model, kernel.tolerance, counts, geometry.obeys)
    cues = []
    if kernel.cues != "epipolar":
        cues.append(accumulate(of_flow(shot, world, model, kernel), count))
    if kernel.cues != "flow":
        cues.append(accumulate(of_views(views, kernel), count))
    affinities = [normalised(*cue[:2], kernel.kernel) for cue in cues]
    if len(cues) == 1:
        affinity = affinities[0]
    else:
        columns = kernel.columns if kernel.fusion == "coregularised" else None
        affinity = fused([completed(a) for a in affinities], columns, kernel.kernel != "merge")
    affinity[0, geometry.obeys] = affinity[geometry.obeys, 0] = 1.0
    by_world = kernel.kernel == "merge" and kernel.cues == "flow"
    return ShotAffinity(
        affinity,
        np.stack([agreement for agreement, _, _ in cues]),
        np.stack([together for _, together, _ in cues]),
        cues[0][2],
        world.static if by_world else ~(affinity[0] < 0.5),
        *_by_pair(world.evidence, size),
    )


def of_flow(shot: Shot, world: World, model: Model, kernel: Kernel) -> Iterator[Agreement]:
    """The kernel of every pair, from the residuals of the motion of flow."""
    if kernel.kernel != "merge":
        for p in shot():
            yield (
                p.ids[p.seen],
                *_ranked(p.found.residual[np.ix_(p.seen, p.seen)], p.found.pixels[p.seen], kernel),
            )
        return
    by_pair = {e.pair: e for e in world.evidence}
    for p in shot():
        if (e := by_pair.get(p.pair)) is not None:
            yield _merged(p, e, model, kernel)


def _merged(p: Pair, e: Evidence, model: Model, kernel: Kernel) -> Agreement:
    """The kernel ``merge`` of one pair; the row of the background is the world's."""
    excess, tolerance = merge(p, model, kernel.tolerance)
    weight = _weights(p.found.pixels[p.seen], kernel)
    mine = (e.excess, e.tolerance, e.weight if kernel.weight == "area" else np.sign(e.weight))
    for matrix, row in zip((excess, tolerance, weight), mine, strict=True):
        matrix[0] = matrix[:, 0] = row
    return e.ids, *_agreement(excess, tolerance, weight)


def of_views(views: Views, kernel: Kernel) -> Iterator[Agreement]:
    """The kernel of every pair, from the residuals of models on each other's points."""
    for ids, residual, points in views:
        if kernel.kernel != "merge":
            yield ids, *_ranked(residual, points, kernel)
        else:
            excess, tolerance = geometric(residual, points, kernel.tolerance)
            yield ids, *_agreement(excess, tolerance, _weights(points, kernel))


def _agreement(excess: Floats, tolerance: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """T / (T + E) (n, n), and what it counts in the mean: so that the mean is mean T / (mean T + mean E)."""
    both = tolerance + excess
    return tolerance / both, shares(excess, tolerance, weight) * both


def _ranked(residual: Floats, pixels: Floats, kernel: Kernel) -> tuple[Floats, Floats]:
    """An ordered kernel (n, n) and its weights."""
    if kernel.kernel == "ordered":
        value = ordered(residual, kernel.share, kernel.ranking)
    else:
        value = ordered_weighted(residual, kernel.ranking)
    return value, _weights(pixels, kernel)


def _weights(pixels: Floats, kernel: Kernel) -> Floats:
    small = np.minimum(pixels[:, None], pixels)
    return np.sqrt(small) if kernel.weight == "area" else np.ones_like(small)


def accumulate(pairs: Iterable[Agreement], count: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Agreement, togetherness and numbers of pairs (count, count), summed over pairs in their order."""
    agreement, together = np.zeros((2, count, count))
    number = np.zeros((count, count), np.int64)
    for ids, value, weight in pairs:
        at = np.ix_(ids, ids)
        agreement[at] += weight * value
        together[at] += weight
        number[at] += 1
    return agreement, together, number


def normalised(agreement: Floats, together: Floats, kernel: str) -> Floats:
    """Affinity (N, N), 0 to 1: agreement over togetherness, symmetric; NaN where two are never seen together.

    The ordered kernels count shared choices; they are divided by the most that any two share.
    """
    known = together > 0
    affinity = np.where(known, agreement / np.where(known, together, 1.0), np.nan)
    if kernel != "merge" and known.any():
        affinity /= max(float(np.nanmax(affinity)), TINY)
    return (affinity + affinity.T) / 2


def completed(affinity: Floats) -> Floats:
    """The affinity (N, N) with what is unknown inferred: never seen together means unknown, not different.

    Such a pair gets the best product of affinities over a common neighbour, and ``UNKNOWN`` where there is none.
    """
    known = np.isfinite(affinity)
    measured = np.where(known, affinity, 0.0)
    out = measured.copy()
    for i in np.flatnonzero((~known).any(1)):
        products = np.where(known[i][None, :] & known, measured[i][None, :] * measured, -1.0)
        best = products.max(1)
        unknown = ~known[i]
        out[i, unknown] = np.where(best >= 0, best, UNKNOWN)[unknown]
    return np.asarray((out + out.T) / 2)


def _by_pair(found: list[Evidence], size: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Excess, tolerance and weight (M, N) of all pairs."""
    excess, tolerance = np.full((2, *size), np.nan)
    weight = np.zeros(size)
    for e in found:
        excess[e.pair, e.ids], tolerance[e.pair, e.ids], weight[e.pair, e.ids] = (
            e.excess,
            e.tolerance,
            e.weight,
        )
    return excess, tolerance, weight
