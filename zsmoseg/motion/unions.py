"""What the best motions of objects, and of every two objects, leave: normal equations add, and are solved by Cholesky.

The fits of ``fit``, in the metric of the whole frame, compiled, for there are N (N - 1) / 2 unions.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled

Array = NDArray[Any]
EXACT = 1e-10
"""Part of the right side that may be left unsolved: its square is what the cost is wrong by."""


@compiled
def least_costs(left: Array, goal: Array, constant: Array, pixels: Array, ridge: float, steps: int) -> Array:
    """Sums of squared residuals (N,) of the best motion of each object; parameters as in ``union_costs``."""
    count, size = goal.shape
    out = np.zeros(count)
    both, factor = np.zeros((size, size)), np.zeros((size, size))
    right, rest, x = np.zeros(size), np.zeros(size), np.zeros(size)
    for i in range(count):
        for r in range(size):
            right[r] = goal[i, r]
            for c in range(size):
                both[r, c] = left[i, r, c]
        gain = _gain(both, right, ridge * pixels[i], steps, factor, rest, x)
        out[i] = max(constant[i] - gain, 0.0)
    return out


@compiled
def union_costs(left: Array, goal: Array, constant: Array, pixels: Array, ridge: float, steps: int) -> Array:
    """Sums of squared residuals (N, N) of the best motion of two objects together; nothing on the diagonal.

    Parameters
    ----------
    left, goal, constant, pixels : (N, K, K), (N, K), (N,), (N,) of ||A x - b||^2 = x'Lx - 2 x'g + c.
    ridge : weight of x = 0 against a pixel.
    steps : refinements at most after the first solution.
    """
    count, size = goal.shape
    out = np.zeros((count, count))
    both, factor = np.zeros((size, size)), np.zeros((size, size))
    right, rest, x = np.zeros(size), np.zeros(size), np.zeros(size)
    for i in range(count):
        for j in range(i):
            for r in range(size):
                right[r] = goal[i, r] + goal[j, r]
                for c in range(size):
                    both[r, c] = left[i, r, c] + left[j, r, c]
            gain = _gain(both, right, ridge * (pixels[i] + pixels[j]), steps, factor, rest, x)
            out[i, j] = out[j, i] = max(constant[i] + constant[j] - gain, 0.0)
    return out


@compiled
def _gain(
    matrix: Array, right: Array, ridge: float, steps: int, factor: Array, rest: Array, x: Array
) -> float:
    """2 x'g - x'Lx at its best x; the last three arrays are scratch."""
    size, largest = len(right), 0.0
    _cholesky(matrix, ridge, factor)
    for r in range(size):
        rest[r], x[r] = right[r], 0.0
        largest = max(largest, abs(right[r]))
    for _ in range(steps + 1):
        _solve(factor, rest)
        unsolved = 0.0
        for r in range(size):
            x[r] += rest[r]
        for r in range(size):
            rest[r] = right[r] - _product(matrix, r, x)
            unsolved = max(unsolved, abs(rest[r]))
        if unsolved <= EXACT * largest:
            break
    gain = 0.0
    for r in range(size):
        gain += x[r] * (rest[r] + right[r])
    return gain


@compiled
def _product(matrix: Array, row: int, x: Array) -> float:
    """A row of a product; a call of BLAS takes longer than eight multiplications."""
    total = 0.0
    for k in range(len(x)):
        total += matrix[row, k] * x[k]
    return total


@compiled
def _cholesky(matrix: Array, ridge: float, factor: Array) -> None:
    """The lower triangle with factor @ factor.T = matrix + ridge, the reciprocals of its diagonal on it.

    A diagonal that rounding takes below the ridge is the ridge.
    """
    size = len(matrix)
    for r in range(size):
        for c in range(r):
            total = matrix[r, c]
            for k in range(c):
                total -= factor[r, k] * factor[c, k]
            factor[r, c] = total * factor[c, c]
        total = matrix[r, r] + ridge
        for k in range(r):
            total -= factor[r, k] * factor[r, k]
        factor[r, r] = 1.0 / np.sqrt(max(total, ridge))


@compiled
def _solve(factor: Array, right: Array) -> None:
    """``right`` becomes the solution, by forward and backward substitution."""
    size = len(right)
    for r in range(size):
        total = right[r]
        for k in range(r):
            total -= factor[r, k] * right[k]
        right[r] = total * factor[r, r]
    for r in range(size - 1, -1, -1):
        total = right[r]
        for k in range(r + 1, size):
            total -= factor[k, r] * right[k]
        right[r] = total * factor[r, r]
