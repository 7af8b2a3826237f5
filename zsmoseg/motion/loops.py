"""The inner loops over labelled pixels, compiled by Numba. What they compute is described where they are called."""

# mypy: disable-error-code="untyped-decorator, assignment, operator"
from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@nb.njit(cache=True)
def gram_matrices(slot: Array, x: Array, y: Array, q: Array, u: Array, v: Array, count: int) -> Array:
    """Sums of products per slot; a pixel with slot below 0 or values that are not finite is left out."""
    height, width = slot.shape
    gram = np.zeros((count, 11, 11))
    psi = np.empty(11)
    for r in range(height):
        for c in range(width):
            n = slot[r, c]
            value = q[r, c] + u[r, c] + v[r, c]
            if n < 0 or not np.isfinite(value):
                continue
            psi[0], psi[1], psi[2], psi[3] = 1.0, x[c], y[r], q[r, c]
            psi[4], psi[5] = x[c] * q[r, c], y[r] * q[r, c]
            psi[6], psi[7], psi[8] = x[c] * x[c], x[c] * y[r], y[r] * y[r]
            psi[9], psi[10] = u[r, c], v[r, c]
            for i in range(11):
                for j in range(i, 11):
                    gram[n, i, j] += psi[i] * psi[j]
    for n in range(count):
        for i in range(11):
            for j in range(i):
                gram[n, i, j] = gram[n, j, i]
    return gram


@nb.njit(cache=True)
def measure_pieces_of(slot: Array, lab: Array, colour: Array) -> tuple[Array, Array]:
    """Area and box per slot; colours are added to ``colour``. The background has no colour and no box."""
    height, width = slot.shape
    count = len(colour)
    area = np.zeros(count, np.int32)
    box = np.full((count, 4), np.nan, np.float32)
    for y in range(height):
        for x in range(width):
            n = slot[y, x]
            area[n] += 1
            if n == 0:
                continue
            code = np.int64(lab[y, x, 0]) * 8 // 256
            for c in range(1, 3):
                part = (np.int64(lab[y, x, c]) - 80) // 16
                code = code * 6 + min(max(part, 0), 5)
            colour[n, code] += 1
            if np.isnan(box[n, 0]):
                box[n, 0], box[n, 1], box[n, 2], box[n, 3] = x, y, x + 1, y + 1
            else:
                box[n, 0], box[n, 2] = min(box[n, 0], x), max(box[n, 2], x + 1)
                box[n, 3] = y + 1
    return area, box
