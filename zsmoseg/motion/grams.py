"""Gram matrices of all objects of a pair in one loop over the pixels, compiled.

Sufficient statistics of linear regression: Rao, "Linear Statistical Inference and its Applications", 1973.
"""

# mypy: disable-error-code="untyped-decorator, assignment, operator"
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.motion.models import SIZE

Array = NDArray[Any]


@compiled
def gram_matrices(slot: Array, x: Array, y: Array, q: Array, u: Array, v: Array, count: int) -> Array:
    """Sums of products (count, 11, 11) of the monomials and the flow, by slot.

    Along a run of pixels of one slot in one row y is constant, so that 25 sums are enough; they are
    expanded where the run ends. The cost does not depend on the number of slots.

    Parameters
    ----------
    slot : (h, w); below 0 = left out, as are pixels whose values are not finite.
    x, y : (w,) and (h,).
    q, u, v : (h, w) inverse depth and flow.
    """
    height, width = slot.shape
    gram = np.zeros((count, SIZE, SIZE))
    for r in range(height):
        c = 0
        while c < width:
            n = slot[r, c]
            start = c
            while c < width and slot[r, c] == n:
                c += 1
            if n >= 0:
                sums = _run_sums(x[start:c], q[r, start:c], u[r, start:c], v[r, start:c])
                _add_run(gram[n], y[r], sums)
    for n in range(count):
        for i in range(SIZE):
            for j in range(i):
                gram[n, i, j] = gram[n, j, i]
    return gram


@compiled
def _run_sums(x: Array, q: Array, u: Array, v: Array) -> tuple[float, ...]:
    """Sums along one run: of powers of x (5), times q (4), times q^2 (3), times u and v (6), times q u and q v (4),
    of u^2, v^2 and u v.
    """
    x0 = x1 = x2 = x3 = x4 = 0.0
    q0 = q1 = q2 = q3 = 0.0
    p0 = p1 = p2 = 0.0
    u0 = u1 = u2 = v0 = v1 = v2 = 0.0
    s0 = s1 = t0 = t1 = 0.0
    uu = vv = uv = 0.0
    for c in range(len(x)):
        a, d, f, g = x[c], np.float64(q[c]), np.float64(u[c]), np.float64(v[c])
        if not np.isfinite(d + f + g):
            continue
        b = a * a
        x0 += 1.0
        x1 += a
        x2 += b
        x3 += a * b
        x4 += b * b
        q0 += d
        q1 += d * a
        q2 += d * b
        q3 += d * a * b
        e = d * d
        p0 += e
        p1 += e * a
        p2 += e * b
        u0 += f
        u1 += f * a
        u2 += f * b
        v0 += g
        v1 += g * a
        v2 += g * b
        s0 += d * f
        s1 += d * f * a
        t0 += d * g
        t1 += d * g * a
        uu += f * f
        vv += g * g
        uv += f * g
    return (
        x0, x1, x2, x3, x4, q0, q1, q2, q3, p0, p1, p2, u0, u1, u2, v0, v1, v2, s0, s1, t0, t1, uu, vv, uv,
    )  # fmt: skip


@compiled
def _add_run(gram: Array, y: float, sums: tuple[float, ...]) -> None:
    """Add the sums of one run to the upper triangle of the Gram matrix of its slot."""
    x0, x1, x2, x3, x4, q0, q1, q2, q3, p0, p1, p2, u0, u1, u2, v0, v1, v2, s0, s1, t0, t1, uu, vv, uv = sums
    z = y * y
    w = z * y
    # in the order of MONOMIALS
    rows = (
        (x0, x1, y * x0, q0, q1, y * q0, x2, y * x1, z * x0, u0, v0),
        (0.0, x2, y * x1, q1, q2, y * q1, x3, y * x2, z * x1, u1, v1),
        (0.0, 0.0, z * x0, y * q0, y * q1, z * q0, y * x2, z * x1, w * x0, y * u0, y * v0),
        (0.0, 0.0, 0.0, p0, p1, y * p0, q2, y * q1, z * q0, s0, t0),
        (0.0, 0.0, 0.0, 0.0, p2, y * p1, q3, y * q2, z * q1, s1, t1),
        (0.0, 0.0, 0.0, 0.0, 0.0, z * p0, y * q2, z * q1, w * q0, y * s0, y * t0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, x4, y * x3, z * x2, u2, v2),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, z * x2, w * x1, y * u1, y * v1),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, z * z * x0, z * u0, z * v0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, uu, uv),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, vv),
    )
    for i in range(SIZE):
        row = rows[i]
        for j in range(i, SIZE):
            gram[i, j] += row[j]
