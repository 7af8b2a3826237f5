"""Least-squares fits of the motion models, from Gram matrices alone.

The rule for degenerate objects (few pixels, a line of pixels, constant depth): what the pixels of an object do
not determine is taken from the fit to the whole frame, not from zero. The normal matrix is measured in the metric
of the whole frame, so that scale, shift and plane of inverse depth do not matter, and solved by Tikhonov
regularisation (Tikhonov and Arsenin, "Solutions of ill-posed problems", 1977) towards the frame's fit, iterated so
that whatever is determined better than 1e-5 of the frame's is exact to 1e-9. What the frame itself does not determine
is nought.
"""

from __future__ import annotations

import numpy as np

from zsmoseg.motion.models import BASIS, Floats, Model, U, V, pixels_of
from zsmoseg.motion.unions import least_costs, union_costs

RIDGE = 1e-8
"""Weight of the frame's fit against an object's pixels, in the metric of the frame: above the rounding of sums in
double precision, below what any object of a few pixels determines."""
SINGULAR = 1e-12
"""Part of the largest eigenvalue below which the frame does not determine a combination of parameters."""
TINY = 1e-12
"""Instead of 0 as divisor."""
STEPS = 3
"""Refinements after the first solution: the bias falls from (ridge / eigenvalue) to its 4th power."""


def moments(gram: Floats, model: Model) -> tuple[Floats, Floats, Floats, Floats]:
    """A'A (..., P, P), A'b (..., P), b'b (...) and pixels (...) of Grams (..., 11, 11), rows of u and v stacked."""
    g = gram[..., :BASIS, :BASIS]
    square = model.rows_u.T @ g @ model.rows_u + model.rows_v.T @ g @ model.rows_v
    right = gram[..., :BASIS, U] @ model.rows_u + gram[..., :BASIS, V] @ model.rows_v
    return (
        np.asarray(square),
        np.asarray(right),
        np.asarray(gram[..., U, U] + gram[..., V, V]),
        pixels_of(gram),
    )


def fit(gram: Floats, model: Model, frame: Floats) -> Floats:
    """Parameters (..., P) of every Gram (..., 11, 11); ``frame`` (11, 11) is the Gram of the whole frame."""
    return _solve(*moments(gram, model)[:2], pixels_of(gram), model, frame)


def own_cost(gram: Floats, model: Model, frame: Floats) -> Floats:
    """(N,) sum of squared residuals of the own fit of each Gram (N, 11, 11), px^2 times pixels."""
    return np.asarray(least_costs(*_towards_frame(gram, model, frame), RIDGE, STEPS))


def joint_costs(gram: Floats, model: Model, frame: Floats) -> Floats:
    """(N, N) the same of one fit to each two Grams of (N, 11, 11); nothing on the diagonal."""
    return np.asarray(union_costs(*_towards_frame(gram, model, frame), RIDGE, STEPS))


def _towards_frame(gram: Floats, model: Model, frame: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Normal equations (N, K, K), (N, K) of the step from the frame's fit, in its metric; costs at it (N,); pixels (N,)."""
    square, right, constant, pixels = moments(gram, model)
    white, toward = _of_frame(model, frame)
    moved = square @ toward
    at_frame = constant + moved @ toward - 2 * (right @ toward)
    left, goal = white.T @ square @ white, (right - moved) @ white
    return np.ascontiguousarray(left), np.ascontiguousarray(goal), at_frame, np.maximum(pixels, TINY)


def _solve(square: Floats, right: Floats, pixels: Floats, model: Model, frame: Floats) -> Floats:
    """Parameters (..., P) from the normal equations, iterated Tikhonov towards those of the frame."""
    white, toward = _of_frame(model, frame)
    count = np.maximum(pixels, TINY)[..., None]
    left = white.T @ square @ white / count[..., None]
    goal = (right - (square @ toward[..., None])[..., 0]) @ white / count
    inverse = np.linalg.inv(left + RIDGE * np.eye(white.shape[1]))
    step = (inverse @ goal[..., None])[..., 0]
    for _ in range(STEPS):
        rest = goal - (left @ step[..., None])[..., 0]
        step = step + (inverse @ rest[..., None])[..., 0]
    return np.asarray(toward + np.where(pixels[..., None] > 0, step @ white.T, 0.0))


def _of_frame(model: Model, frame: Floats) -> tuple[Floats, Floats]:
    """The metric (P, K) of the whole frame, and its fit (P,)."""
    square, right, _, pixels = moments(frame, model)
    total = max(float(pixels), 1.0)
    white = _whitening(square / total)
    return white, np.asarray(white @ (white.T @ right) / total)


def _whitening(square: Floats) -> Floats:
    """(P, K) combinations of parameters that the frame determines, each of mean square 1 over its pixels."""
    unit = np.sqrt(np.maximum(np.diagonal(square), TINY))
    values, vectors = np.linalg.eigh(square / unit[:, None] / unit)
    known = values > SINGULAR * max(float(values[-1]), SINGULAR)
    return np.asarray(vectors[:, known] / np.sqrt(values[known]) / unit[:, None])
