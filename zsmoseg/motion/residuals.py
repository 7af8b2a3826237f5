"""How well the model of one object explains another: the residual tensor, and the cost of one motion for two.

Residual tensor: Huang, Chen, Zelek (the paper). Costs of merging: Ward, "Hierarchical grouping to optimize an objective
function", JASA 1963.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from zsmoseg.motion.fit import fit, joint_costs, own_cost
from zsmoseg.motion.models import BASIS, LEAST, SIZE, Floats, Model, U, V, pixels_of


def residuals(gram: Floats, theta: Floats, model: Model) -> Floats:
    """E (I, N): mean squared residual of parameters ``theta`` (I, P) on the pixels of ``gram`` (N, 11, 11), px^2.

    Quadratic forms of all pairs at once, so the cost hardly grows with the number of objects. NaN where n has no
    pixels.
    """
    outer = np.zeros((len(theta), SIZE, SIZE))
    for rows, flow in ((model.rows_u, U), (model.rows_v, V)):
        w = np.zeros((len(theta), SIZE))
        w[:, :BASIS], w[:, flow] = theta @ rows.T, -1.0
        outer += w[:, :, None] * w[:, None, :]
    total = outer.reshape(len(theta), -1) @ gram.reshape(len(gram), -1).T
    pixels = pixels_of(gram)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(pixels > 0, np.maximum(total, 0.0) / pixels, np.nan)


@dataclass(frozen=True)
class PairResiduals:
    """How well the motions of one pair's S slots explain each other; NaN where either is unseen."""

    pixels: Floats
    """(S,) pixels that count."""
    own: Floats
    """(S,) px^2, mean square that the own motion of each leaves."""
    merge: Floats
    """(S, S) px^2, what one motion for two costs over two motions, a pixel of the smaller; symmetric."""
    residual: Floats
    """(S, S) px^2, mean square that the motion of one (row) leaves on the pixels of another: e[m, i, n] of the paper."""
    coefficient: Floats
    """(S, terms) parameters of the motion of each."""


def pair_residuals(gram: Floats, model: Model) -> PairResiduals:
    """The residuals of one pair.

    Parameters
    ----------
    gram : (slots, 11, 11), the background first.
    """
    count, pixels = len(gram), pixels_of(gram).copy()
    seen = np.flatnonzero(pixels >= LEAST)
    own, coefficient = np.full(count, np.nan), np.full((count, model.parameters), np.nan)
    merge, residual = np.full((2, count, count), np.nan)
    if len(seen):
        frame, at = gram.sum(0), np.ix_(seen, seen)
        theta = fit(gram[seen], model, frame)
        residual[at], coefficient[seen] = residuals(gram[seen], theta, model), theta
        merge[at], own[seen] = merge_costs(gram[seen], model, frame)
    return PairResiduals(pixels, own, merge, residual, coefficient)


def residuals_of_pairs(grams: Floats, model: Model) -> PairResiduals:
    """The residuals of M pairs (M, slots, 11, 11): all fields with a first axis of length M."""
    blank = pair_residuals(np.zeros(grams.shape[1:]), model)
    found = [pair_residuals(gram, model) for gram in grams]
    tables = {
        f.name: np.array([getattr(one, f.name) for one in found]).reshape(-1, *getattr(blank, f.name).shape)
        for f in fields(PairResiduals)
    }
    return PairResiduals(**tables)


def merge_costs(gram: Floats, model: Model, frame: Floats) -> tuple[Floats, Floats]:
    """What it costs to give two objects one motion instead of two.

    ``d[i, n] = (SSE of one fit to both - SSE_i - SSE_n) / min(|i|, |n|)``, px^2: unlike ``e[i, n] - e[n, n]`` it
    never extrapolates the model of a small object to a far one.

    Parameters
    ----------
    gram : (N, 11, 11).
    frame : (11, 11) the Gram of the whole frame.

    Returns
    -------
    d (N, N) : symmetric, zero diagonal.
    own (N,) : own-fit mean squared residual, px^2.
    """
    pixels = np.maximum(pixels_of(gram), 1.0)
    own, joint = own_cost(gram, model, frame), joint_costs(gram, model, frame)
    cost = np.maximum(joint - (own[:, None] + own), 0.0) / np.minimum(pixels[:, None], pixels)
    np.fill_diagonal(cost, 0.0)
    return cost, own / pixels
