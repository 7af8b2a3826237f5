"""Contour accuracy F: how much of the outlines of two masks lies near the other (Perazzi et al. 2016)."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.metrics.counts import Mask

BOUND = 0.008
"""Tolerance of the DAVIS evaluators, as a share of the image diagonal."""


class Contour(NamedTuple):
    """The outline of one mask, cut to what lies near it.

    Attributes
    ----------
    top, left : where the cut-out lies in the frame.
    edge, near : (h, w) the outline, and the pixels within the tolerance of it.
    length : pixels of the outline.
    """

    top: int
    left: int
    edge: NDArray[np.bool_]
    near: NDArray[np.bool_]
    length: int


def tolerance(shape: tuple[int, ...], bound: float = BOUND) -> float:
    """Pixels within which outlines match: a share of the diagonal rounded up, or pixels if 1 or more."""
    return float(bound if bound >= 1 else math.ceil(bound * math.hypot(*shape)))


def boundary_map(mask: Mask) -> NDArray[np.bool_]:
    """Pixels of (H, W) that differ from their right, lower or lower-right neighbour.

    The last row and column count as repeated, so a mask has no outline along the image border.
    """
    edge = np.zeros(mask.shape, np.bool_)
    edge[:, :-1] = mask[:, :-1] != mask[:, 1:]
    edge[:-1] |= mask[:-1] != mask[1:]
    edge[:-1, :-1] |= mask[:-1, :-1] != mask[1:, 1:]
    return edge


def contour(mask: Mask, radius: float, box: tuple[slice, slice] | None = None) -> Contour:
    """The outline of a mask.

    Parameters
    ----------
    mask : (h, w) the mask, whole or the part that ``box`` cuts out.
    radius : tolerance in pixels.
    box : where the mask lies; needs a margin of ``margin(radius)`` or the image border round the mask.
    """
    top, left = (0, 0) if box is None else (box[0].start, box[1].start)
    edge = boundary_map(mask)
    length = int(np.count_nonzero(edge))
    if not length:
        return Contour(top, left, edge, edge, 0)
    near = cv2.dilate(edge.view(np.uint8), _disk(radius), borderValue=0)
    return Contour(top, left, edge, near.view(np.bool_), length)


@cache
def _disk(radius: float) -> NDArray[np.uint8]:
    """All pixels at most ``radius`` from the middle one."""
    reach = np.arange(-math.floor(radius), math.floor(radius) + 1)
    return (reach[:, None] ** 2 + reach**2 <= radius**2).astype(np.uint8)


def grow(box: tuple[slice, slice], radius: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The box of a mask with room for its outline and all that lies near it, inside the frame."""
    room = int(np.ceil(radius)) + 2
    rows, columns = (
        slice(max(side.start - room, 0), min(side.stop + room, size))
        for side, size in zip(box, shape, strict=True)
    )
    return rows, columns


def contour_f(truth: Contour | None, prediction: Contour | None) -> float:
    """F of two outlines of one frame; ``None`` is an empty mask. Both without outline 1, one of them 0."""
    lengths = [0 if c is None else c.length for c in (truth, prediction)]
    if truth is None or prediction is None or not all(lengths):
        return float(not any(lengths))
    precision = _covered(prediction, truth) / prediction.length
    recall = _covered(truth, prediction) / truth.length
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _covered(inner: Contour, outer: Contour) -> int:
    """Pixels of the outline ``inner`` that lie near ``outer``."""
    rows = _common(inner.top, inner.edge.shape[0], outer.top, outer.near.shape[0])
    columns = _common(inner.left, inner.edge.shape[1], outer.left, outer.near.shape[1])
    if rows is None or columns is None:
        return 0
    edge: NDArray[Any] = inner.edge[rows[0], columns[0]]
    return int(np.count_nonzero(edge & outer.near[rows[1], columns[1]]))


def _common(start: int, size: int, other: int, other_size: int) -> tuple[slice, slice] | None:
    """Where two ranges overlap, seen from each; ``None`` if they do not."""
    low, high = max(start, other), min(start + size, other + other_size)
    return None if low >= high else (slice(low - start, high - start), slice(low - other, high - other))
