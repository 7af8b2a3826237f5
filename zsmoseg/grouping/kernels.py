"""Kernels: from the residuals of one pair of frames to who agrees with whom.

Ordered residual kernel: Chin, Wang, Suter, "The ordered residual kernel for robust motion subspace clustering", NIPS
2009; Huang, Chen, Zelek (the paper), section on the affinity.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from zsmoseg.grouping.world import Pair, Tolerance, chance, deviation
from zsmoseg.motion.models import Floats, Model


def preferences(residual: Floats, chosen: int, ranking: Literal["row", "column"]) -> Floats:
    """0/1 matrix, a row an object: the ``chosen`` smallest residuals.

    ``row``: the objects that model i explains best, the letter of the paper. ``column``: the models that explain
    object i best (Chin, Wang, Suter 2009, whom it cites).
    """
    values = residual if ranking == "row" else residual.T
    rank = np.argsort(np.argsort(values, axis=1, kind="stable"), axis=1, kind="stable")
    return (rank < chosen).astype(np.float64)


def ordered(residual: Floats, share: float, ranking: Literal["row", "column"]) -> Floats:
    """Ordered residual kernel of one pair, truncated: d[i, j] = v_i . v_j (paper, section on the affinity).

    Parameters
    ----------
    residual : (n, n) of the objects seen, row = model.
    share : part of them that each chooses, at least one.
    """
    v = preferences(residual, max(1, round(share * len(residual))), ranking)
    return v @ v.T


def ordered_weighted(residual: Floats, ranking: Literal["row", "column"]) -> Floats:
    """Ordered residual kernel over all lengths, weights 1 / t (Chin, Wang, Suter 2009), 0 to 1."""
    count = len(residual)
    weights = 1.0 / np.arange(1, count + 1)
    before, out = np.zeros((count, count)), np.zeros((count, count))
    for t, weight in enumerate(weights, start=1):
        v = preferences(residual, t, ranking)
        now = v @ v.T
        out += weight * (now - before)
        before = now
    return np.asarray(out / weights.sum())


def merge(p: Pair, model: Model, k: Tolerance) -> tuple[Floats, Floats]:
    """What one motion for two costs and what is tolerated, px, (n, n) each, of the objects seen in one pair.

        E[i, j] = bridge[i, j] sqrt((SSE(i + j) - SSE(i) - SSE(j)) / min(|i|, |j|) - chance)
        T[i, j] = floor + sqrt(pair (s2(i) + s2(j)))

    with s2 and the chance as in ``world``. Unlike residuals of one's motion on the other's pixels, the cost of merging
    never extrapolates the motion of a small thing to a far one (Ward, "Hierarchical grouping to optimize an objective
    function", JASA 1963). But the farther apart two things are, the less it costs to bridge them by a stretch that
    neither shows, where the model has one; the factor is 1 where they touch, or it has none.
    """
    seen, found = p.seen, p.found
    pixels, own, own2 = found.pixels[seen], found.own[seen], deviation(p)
    small = np.minimum(pixels[:, None], pixels)
    noise = np.minimum((own[:, None] + own) / 2, own[0])
    square = found.merge[np.ix_(seen, seen)] - chance(noise, small, model, k)
    excess = np.sqrt(np.maximum(square, 0.0))
    if model.stretches:
        excess *= np.sqrt(distances(p.gram[seen]))
    return excess, k.floor + np.sqrt(k.pair * (own2[:, None] + own2))


def distances(gram: Floats) -> Floats:
    """How far apart things are (n, n), over that of discs of their extents that touch; at least 1.

    Two velocities that differ by v, of things of radius r whose centres are d apart, are one stretch by v / d, which strays by
    r v / d within either: what it costs falls with d. The kernel takes the root of this, for what else is wrong with one motion
    for both, as a depth that is none, does not fall.

    Parameters
    ----------
    gram : (n, 11, 11) sums of products of ``MONOMIALS``.
    """
    pixels = gram[:, 0, 0]
    centre = gram[:, 0, 1:3] / pixels[:, None]
    square = (gram[:, 1, 1] + gram[:, 2, 2]) / pixels - (centre**2).sum(1)
    # of a disc the mean square distance from its centre is r^2 / 2
    radius = np.sqrt(2 * np.maximum(square, 0.0))
    apart = np.linalg.norm(centre[:, None] - centre, axis=2)
    touching = radius[:, None] + radius
    ratio = np.divide(apart, touching, out=np.ones_like(apart), where=touching > 0)
    return np.asarray(np.maximum(ratio, 1.0))


def geometric(residual: Floats, pixels: Floats, k: Tolerance) -> tuple[Floats, Floats]:
    """The same where only residuals of models on each other's points are known: of the larger's on the smaller's.

    A model that is used on foreign points errs by as much as it and theirs do on their own.

        E[i, j] = sqrt(e[i, j] - e[j, j])      i the larger
        T[i, j] = floor + sqrt(e[i, i] + e[j, j])

    Parameters
    ----------
    residual : (n, n) px^2 of the objects seen, row = model.
    pixels : (n,) pixels or points of each.
    """
    own = np.diagonal(residual)
    over = np.sqrt(np.maximum(residual - own, 0.0))
    equal = pixels[:, None] == pixels
    excess = np.where(equal, np.maximum(over, over.T), np.where(pixels[:, None] > pixels, over, over.T))
    return excess, k.floor + np.sqrt(own[:, None] + own)


def shared_choices(residual: Floats, share: float) -> Floats:
    """Part of the hypotheses that two points choose both, 0 to 1: the truncated kernel of rectangular residuals.

    Each point chooses the ``share`` of the hypotheses that explain it best; hypotheses need not be points
    themselves (Xu, Cheong, Li 2018 after Chin, Wang, Suter 2009). Equals ``ordered`` by columns over the choices.

    Parameters
    ----------
    residual : (hypotheses, N).

    Returns
    -------
    (N, N), 1 on the diagonal.
    """
    hypotheses, count = residual.shape
    chosen = max(1, round(share * hypotheses))
    best = np.argpartition(residual, chosen - 1, axis=0)[:chosen]
    v = np.zeros((count, hypotheses), np.float32)
    v[np.arange(count), best] = 1.0
    return np.asarray((v @ v.T) / np.float32(chosen), np.float64)
