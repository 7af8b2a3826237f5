"""A mask moved to the edges of a picture.

Source: He, Sun, Tang, "Guided image filtering", PAMI 2013.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zsmoseg.proposals.embedded.aliases import Singles


@dataclass(frozen=True, kw_only=True)
class GuidedFilter:
    """Windows and edges of the guided filter."""

    guide_radius: int
    """Radius of the windows, px."""
    guide_eps: float = 1e-4
    """Variance of the guide below which nothing is an edge, squared colour, 0 to 1. Halved or doubled it changes J by 0.04 at most."""


def guided_filter(guide: Singles, x: Singles, parameters: GuidedFilter) -> Singles:
    """``x`` (h, w) as a local linear function of the colours of ``guide`` (h, w, 3), 0 to 1."""

    def mean(image: Singles) -> Singles:
        side = 2 * parameters.guide_radius + 1
        return np.asarray(cv2.boxFilter(image, -1, (side, side), borderType=cv2.BORDER_REFLECT), np.float32)

    middle, level = mean(guide), mean(x)
    joint = mean(guide * x[..., None]) - middle * level[..., None]
    square = mean(guide * guide) - middle * middle + np.float32(parameters.guide_eps)
    mixed = mean(guide * guide[..., [1, 2, 0]]) - middle * middle[..., [1, 2, 0]]
    factor = _solve(square, mixed, joint)
    return np.asarray((mean(factor) * guide).sum(-1) + mean(level - (factor * middle).sum(-1)), np.float32)


def _solve(square: Singles, mixed: Singles, right: Singles) -> Singles:
    """Per pixel the solution of a symmetric 3 x 3 system: diagonal, (01, 12, 20) and right side (h, w, 3).

    By the adjugate, all pixels at once: a general solver would be called for each.
    """
    a, d, f = np.moveaxis(square, -1, 0)
    b, e, c = np.moveaxis(mixed, -1, 0)
    r0, r1, r2 = np.moveaxis(right, -1, 0)
    m00, m01, m02 = d * f - e * e, c * e - b * f, b * e - c * d
    m11, m12, m22 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * m00 + b * m01 + c * m02
    rows = (m00 * r0 + m01 * r1 + m02 * r2, m01 * r0 + m11 * r1 + m12 * r2, m02 * r0 + m12 * r1 + m22 * r2)
    return np.asarray(np.stack(rows, -1) / determinant[..., None], np.float32)
