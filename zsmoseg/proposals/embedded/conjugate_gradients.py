"""The solver of ``diffusion``, compiled: conjugate gradients with the diagonal as preconditioner.

Two right sides at once, for what takes the time is to read the matrix, and in single precision, for the tolerance is
coarse. Written out for two columns: arrays of two would be read and written in the innermost loop.

Source: Hestenes, Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 1952.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Singles

Index = NDArray[np.int32]
Pair = tuple[float, float]


@compiled
def conjugate_gradients(
    start: Index,
    index: Index,
    weight: Singles,
    trust: Singles,
    x: Singles,
    strength: float,
    tolerance: float,
    rounds: int,
) -> Singles:
    """Solve (trust + strength (D - W)) z = trust x, beginning with z = x.

    Parameters
    ----------
    start, index, weight
        W (n, n) in compressed rows, symmetric: (n + 1), (m), (m). D is the diagonal of its row sums.
    trust, x
        (n) and (n, 2).
    strength
        Of W.
    tolerance
        Norm of the residual over that of the right side at which both columns are done.
    rounds
        Most steps.

    Returns
    -------
    z (n, 2).
    """
    s, n = np.float32(strength), len(x)
    diagonal, z = np.empty(n, np.float32), x.copy()
    rest, step, image = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    goal = _begin(start, index, weight, trust, x, s, tolerance, diagonal, rest)
    product, square = _precondition(diagonal, rest, step)
    for _ in range(rounds):
        if square[0] <= goal[0] and square[1] <= goal[1]:
            break
        curvature = _multiply(start, index, weight, diagonal, s, step, image)
        c0, c1 = _ratio(product[0], curvature[0]), _ratio(product[1], curvature[1])
        following, square = _advance(c0, c1, step, image, diagonal, z, rest)
        h0, h1 = _ratio(following[0], product[0]), _ratio(following[1], product[1])
        product = following
        for i in range(n):
            step[i, 0] = rest[i, 0] / diagonal[i] + h0 * step[i, 0]
            step[i, 1] = rest[i, 1] / diagonal[i] + h1 * step[i, 1]
    return z


@compiled
def _ratio(above: float, below: float) -> np.float32:
    """0 where a column is solved exactly."""
    return np.float32(above / below) if below > 0 else np.float32(0)


@compiled
def _begin(
    start: Index,
    index: Index,
    weight: Singles,
    trust: Singles,
    x: Singles,
    s: np.float32,
    tolerance: float,
    diagonal: Singles,
    rest: Singles,
) -> Pair:
    """Fill the diagonal of the matrix and the residual of x; the squared norms of the residual to reach."""
    goal0, goal1 = 0.0, 0.0
    for i in range(len(x)):
        degree, a0, a1 = np.float32(0), np.float32(0), np.float32(0)
        for k in range(start[i], start[i + 1]):
            degree += weight[k]
            a0 += weight[k] * x[index[k], 0]
            a1 += weight[k] * x[index[k], 1]
        diagonal[i] = trust[i] + s * degree
        t0, t1 = trust[i] * x[i, 0], trust[i] * x[i, 1]
        goal0 += tolerance * tolerance * t0 * t0
        goal1 += tolerance * tolerance * t1 * t1
        rest[i, 0] = t0 - diagonal[i] * x[i, 0] + s * a0
        rest[i, 1] = t1 - diagonal[i] * x[i, 1] + s * a1
    return goal0, goal1


@compiled
def _precondition(diagonal: Singles, rest: Singles, step: Singles) -> tuple[Pair, Pair]:
    """Fill the first step, rest / diagonal; rest · step, and rest · rest."""
    product0, product1, square0, square1 = 0.0, 0.0, 0.0, 0.0
    for i in range(len(rest)):
        step[i, 0], step[i, 1] = rest[i, 0] / diagonal[i], rest[i, 1] / diagonal[i]
        product0 += rest[i, 0] * step[i, 0]
        product1 += rest[i, 1] * step[i, 1]
        square0 += rest[i, 0] ** 2
        square1 += rest[i, 1] ** 2
    return (product0, product1), (square0, square1)


@compiled
def _multiply(
    start: Index,
    index: Index,
    weight: Singles,
    diagonal: Singles,
    s: np.float32,
    step: Singles,
    image: Singles,
) -> Pair:
    """Fill ``image``, the matrix times the step; step · image."""
    curvature0, curvature1 = 0.0, 0.0
    for i in range(len(step)):
        a0, a1 = np.float32(0), np.float32(0)
        for k in range(start[i], start[i + 1]):
            w, j = weight[k], index[k]
            a0 += w * step[j, 0]
            a1 += w * step[j, 1]
        b0, b1 = diagonal[i] * step[i, 0] - s * a0, diagonal[i] * step[i, 1] - s * a1
        image[i, 0], image[i, 1] = b0, b1
        curvature0 += step[i, 0] * b0
        curvature1 += step[i, 1] * b1
    return curvature0, curvature1


@compiled
def _advance(
    c0: np.float32,
    c1: np.float32,
    step: Singles,
    image: Singles,
    diagonal: Singles,
    z: Singles,
    rest: Singles,
) -> tuple[Pair, Pair]:
    """Go ``c0`` and ``c1`` steps; rest · rest / diagonal, and rest · rest, of the new residual."""
    product0, product1, square0, square1 = 0.0, 0.0, 0.0, 0.0
    for i in range(len(z)):
        z[i, 0] += c0 * step[i, 0]
        z[i, 1] += c1 * step[i, 1]
        r0, r1 = rest[i, 0] - c0 * image[i, 0], rest[i, 1] - c1 * image[i, 1]
        rest[i, 0], rest[i, 1] = r0, r1
        product0 += r0 * r0 / diagonal[i]
        product1 += r1 * r1 / diagonal[i]
        square0 += r0 * r0
        square1 += r1 * r1
    return (product0, product1), (square0, square1)
