"""How well the model of one object explains another: the residual tensor, and the cost of one motion for two.

Residual tensor: Huang, Chen, Zelek (the paper). Costs of merging: Ward, "Hierarchical grouping to optimize an objective
function", JASA 1963.
"""

from __future__ import annotations

import numpy as np

from zsmoseg.motion.fit import fit, own_cost
from zsmoseg.motion.models import BASIS, SIZE, Floats, Model, U, V, pixels_of

LEAST = 12
"""Pixels of the working grid below which an object counts as unseen in a pair: two equations each, about two for
each parameter of the largest model."""


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


def pair_residuals(gram: Floats, model: Model) -> tuple[Floats, Floats, Floats]:
    """The residual tensor of one pair.

    Parameters
    ----------
    gram : (slots, 11, 11), the background first.

    Returns
    -------
    residual (slots, slots) : row = model, column = pixels; px^2, NaN where either is unseen.
    pixels (slots,)
    coefficient (slots, terms) : NaN where unseen.
    """
    count = len(gram)
    seen = np.flatnonzero(pixels_of(gram) >= LEAST)
    residual = np.full((count, count), np.nan)
    coefficient = np.full((count, model.parameters), np.nan)
    if len(seen):
        theta = fit(gram[seen], model, gram.sum(0))
        residual[np.ix_(seen, seen)] = residuals(gram[seen], theta, model)
        coefficient[seen] = theta
    return residual, pixels_of(gram).copy(), coefficient


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
    pixels = pixels_of(gram)
    own = own_cost(gram, model, frame)
    i, k = np.triu_indices(len(gram), 1)
    joint = own_cost(gram[i] + gram[k], model, frame)
    d = np.zeros((len(gram), len(gram)))
    d[i, k] = d[k, i] = np.maximum(joint - own[i] - own[k], 0.0) / np.maximum(
        np.minimum(pixels[i], pixels[k]), 1.0
    )
    return d, own / np.maximum(pixels, 1.0)
