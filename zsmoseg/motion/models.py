r"""Linear motion models: the flow of a rigid body seen by a moving pinhole camera.

With x, y from the principal point and inverse depth known up to scale, 1/z = s q, equation 1 of the paper
(Longuet-Higgins and Prazdny, "The interpretation of a moving retinal image", 1980) is linear in eight parameters,
five of them shared by both rows::

    u = a  + b  q - c x q - d y + e x^2 - g x y          screw
    v = a' + b' q - c y q + d x + e x y - g y^2

(a = f w2, a' = -f w1, b = s f t1, b' = s f t2, c = s t3, d = w3, e = w2 / f, g = w1 / f.) Equation 3 as printed
has -d x and +g y^2 in the second row, which can represent neither roll nor pitch: ``screw-printed``. Inverse
depth known up to scale and shift adds one shared column k (x, y): ``screw-shift``; up to a plane:
``screw-plane``. ``quadratic`` is equation 2, ``affine`` its linear part, ``planar`` the flow of a plane.

Every row of every model is a combination of nine monomials, so their sums of products serve all models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MONOMIALS = ("1", "x", "y", "q", "xq", "yq", "xx", "xy", "yy", "u", "v")
"""Order of a Gram matrix; the last two are the flow itself."""
BASIS = 9
"""Monomials of the place and of inverse depth."""
U, V = 9, 10
"""Place of the flow among them."""
SIZE = 11
LEAST = 12
"""Pixels of the working grid below which an object counts as unseen in a pair: two equations each, about two for
each parameter of the largest model."""


@dataclass(frozen=True)
class Model:
    """``u = phi @ rows_u @ theta``, ``v = phi @ rows_v @ theta`` with the nine monomials phi."""

    terms: tuple[str, ...]
    rows_u: Floats
    rows_v: Floats

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return len(self.terms)

    @cached_property
    def stretches(self) -> bool:
        """Whether it has any linear part, whatever the depth: then it can bridge any two velocities by a stretch."""
        linear = [MONOMIALS.index("x"), MONOMIALS.index("y")]
        return bool(np.linalg.matrix_rank(np.concatenate([self.rows_u[linear], self.rows_v[linear]])) == 4)


Terms = Sequence[tuple[str, Mapping[str, float], Mapping[str, float]]]


def _model(columns: Terms) -> Model:
    rows = np.zeros((2, BASIS, len(columns)))
    for p, (_, *both) in enumerate(columns):
        for row, terms in enumerate(both):
            for name, factor in terms.items():
                rows[row, MONOMIALS.index(name), p] = factor
    return Model(tuple(name for name, _, _ in columns), rows[0], rows[1])


_SHIFT: Terms = [("a", {"1": 1}, {}), ("a'", {}, {"1": 1})]
_PARALLAX: Terms = [("b", {"q": 1}, {}), ("b'", {}, {"q": 1}), ("c", {"xq": -1}, {"yq": -1})]
_ROLL: Terms = [("d", {"y": -1}, {"x": 1})]
_TURN: Terms = [("e", {"xx": 1}, {"xy": 1}), ("g", {"xy": -1}, {"yy": -1})]
_ZOOM: Terms = [("k", {"x": 1}, {"y": 1})]
_LINEAR: Terms = [("ux", {"x": 1}, {}), ("uy", {"y": 1}, {}), ("vx", {}, {"x": 1}), ("vy", {}, {"y": 1})]
_SQUARES: Terms = [
    *((f"u{m}", {m: 1.0}, {}) for m in ("xx", "xy", "yy")),
    *((f"v{m}", {}, {m: 1.0}) for m in ("xx", "xy", "yy")),
]
_PRINTED: Terms = [
    ("d", {"y": -1}, {"x": -1}),
    ("e", {"xx": 1}, {"xy": 1}),
    ("g", {"xy": -1}, {"yy": 1}),
]

MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "screw": _model([*_SHIFT, *_PARALLAX, *_ROLL, *_TURN]),
        "screw-shift": _model([*_SHIFT, *_PARALLAX, *_ROLL, *_TURN, *_ZOOM]),
        "screw-printed": _model([*_SHIFT, *_PARALLAX, *_PRINTED]),
        "screw-plane": _model([*_SHIFT, *_LINEAR, *_PARALLAX, *_TURN]),
        "quadratic": _model([*_SHIFT, *_LINEAR, *_SQUARES]),
        "planar": _model([*_SHIFT, *_LINEAR, *_TURN]),
        "affine": _model([*_SHIFT, *_LINEAR]),
        "translation": _model(_SHIFT),
    }
)
"""All models by the name of the setting ``motion.model``."""


def coordinates(height: int, width: int) -> tuple[Floats, Floats]:
    """Places x (w,) and y (h,) from the image centre, in units of half the long side: conditioning only."""
    scale = 2.0 / max(height, width)
    x, y = (np.arange(n, dtype=np.float64) - (n - 1) / 2 for n in (width, height))
    return x * scale, y * scale


def pixels_of(gram: Floats) -> Floats:
    """(...) pixels behind each Gram matrix (..., 11, 11): the sum of 1 times 1."""
    return np.asarray(gram[..., 0, 0])


def normalise(inverse_depth: NDArray[np.floating]) -> Floats:
    """Inverse depth (h, w) over its mean magnitude: conditioning only, its zero stays where it is."""
    q = np.asarray(inverse_depth, np.float64)
    scale = float(np.mean(np.abs(q[np.isfinite(q)]))) if np.isfinite(q).any() else 0.0
    return q / scale if scale > 0 else np.zeros_like(q)
