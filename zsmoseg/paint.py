"""From superpixels to pixels of the displayed size.

Source of the filter: He, Sun, Tang, "Guided image filtering", PAMI 2013.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings

Image = NDArray[np.float32]


def paint(
    frame: NDArray[np.uint8],
    segment: NDArray[np.uint16],
    value: NDArray[np.float32],
    ids: NDArray[np.int32],
    shape: tuple[int, int],
    s: settings.Labels,
) -> NDArray[np.uint16]:
    """The object of every pixel of one frame.

    Parameters
    ----------
    frame
        (h, w, 3) on the working grid, blue green red.
    segment
        (h, w) superpixels.
    value, ids
        (superpixels) log-odds of being foreground, and object, 0 = none.
    shape
        Displayed height and width.
    s
        The section ``labels`` of the settings.

    Returns
    -------
    (H, W): object, 0 = none.
    """
    if not ids.any():
        return np.zeros(shape, np.uint16)
    label = ids[segment]
    box = _box(label > 0, 3 * s.guide_radius)
    inside = label[box]
    soft = np.zeros(label.shape, np.float32)
    guide = frame[box].astype(np.float32) / np.float32(255)
    soft[box] = guided_filter(guide, (inside > 0).astype(np.float32), s.guide_radius, s.guide_eps)
    mask = cv2.resize(soft, shape[::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    label[box] = spread_ids(inside)
    full = cv2.resize(label, shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    return np.where(mask, full, 0).astype(np.uint16)


def _box(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The smallest box around a mask that is not empty, and a margin."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(columns[0] - margin, 0), columns[-1] + margin + 1),
    )


def spread_ids(label: NDArray[np.int32]) -> NDArray[np.int32]:
    """(h, w) the nearest id above 0 at every pixel; there must be one."""
    empty = (label == 0).astype(np.uint8)
    _, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    table = np.zeros(int(nearest.max()) + 1, np.int32)
    table[nearest[label > 0]] = label[label > 0]
    return table[nearest]


def guided_filter(guide: Image, x: Image, radius: int, eps: float) -> Image:
    """``x`` (h, w) as a local linear function of the colours of ``guide`` (h, w, 3), 0 to 1.

    Parameters
    ----------
    radius
        Of the windows, px.
    eps
        Variance of the guide below which nothing is an edge.
    """

    def mean(image: Image) -> Image:
        side = 2 * radius + 1
        return np.asarray(cv2.boxFilter(image, -1, (side, side), borderType=cv2.BORDER_REFLECT), np.float32)

    middle, level = mean(guide), mean(x)
    joint = mean(guide * x[..., None]) - middle * level[..., None]
    square = mean(guide * guide) - middle * middle + np.float32(eps)
    mixed = mean(guide * guide[..., [1, 2, 0]]) - middle * middle[..., [1, 2, 0]]
    factor = _solve(square, mixed, joint)
    return np.asarray((mean(factor) * guide).sum(-1) + mean(level - (factor * middle).sum(-1)), np.float32)


def _solve(square: Image, mixed: Image, right: Image) -> Image:
    """Per pixel the solution of a symmetric 3 x 3 system: diagonal, (01, 12, 20) and right side (h, w, 3)."""
    a, d, f = np.moveaxis(square, -1, 0)
    b, e, c = np.moveaxis(mixed, -1, 0)
    r0, r1, r2 = np.moveaxis(right, -1, 0)
    m00, m01, m02 = d * f - e * e, c * e - b * f, b * e - c * d
    m11, m12, m22 = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * m00 + b * m01 + c * m02
    rows = (m00 * r0 + m01 * r1 + m02 * r2, m01 * r0 + m11 * r1 + m12 * r2, m02 * r0 + m12 * r1 + m22 * r2)
    return np.asarray(np.stack(rows, -1) / determinant[..., None], np.float32)
