"""Kernels: from the residuals of one pair to who agrees with whom.

Ordered residual kernel: Chin, Wang, Suter, "The ordered residual kernel for robust motion subspace clustering", NIPS
2009; Huang, Chen, Zelek (the paper), section on the affinity.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from zsmoseg.motion.models import Floats


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


def inlier(residual: Floats, pixels: Floats, factor: float, floor: float) -> Floats:
    """1 where the model of the larger of two objects explains the smaller about as well as its own does.

    Parameters
    ----------
    factor : times the larger of the two own residuals, as root mean squares.
    floor : px, residuals below it are noise.
    """
    own = np.diagonal(residual)
    limit = factor**2 * (np.maximum(own[:, None], own[None, :]) + floor**2)
    fits = (residual < limit).astype(np.float64)
    return np.where(pixels[:, None] >= pixels[None, :], fits, fits.T)


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
