"""The one pass over the pixels: sums of products of which every model, residual and joint fit is made.

Row n of the result is the Gram matrix of (1, x, y, q, xq, yq, x^2, xy, y^2, u, v) over the pixels of object n.
Grams of disjoint sets add. The background is cut into a fixed grid of cells besides: pieces of the static world
as large as an object, seen through the same flow and depth; they are the yardstick of the decision.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.motion.loops import gram_matrices
from zsmoseg.motion.models import Floats, coordinates, normalise

UNUSED = -1
FAR = 1e6
"""px: no flow leads there."""
MOST = 0.95
"""Part of all objects' pixels from which on a lacking way back tells nothing of them: no flow closes on them."""


def pair_statistics(
    label: NDArray[np.integer[Any]],
    ids: NDArray[np.int64],
    flow: NDArray[np.float32],
    backward: NDArray[np.float32] | None,
    inverse_depth: NDArray[np.floating] | None,
    ignore: NDArray[np.bool_] | None,
    s: settings.Statistics,
) -> Floats:
    """Gram matrices of one pair.

    Parameters
    ----------
    label : (h, w) object of every pixel on the working grid, 0 = background.
    ids : (slots,) the objects asked for, ascending, 0 first.
    flow : (2, h, w) px; NaN = unknown.
    backward : (2, h, w) px, the flow back; None: the flow there is right everywhere.
    inverse_depth : (h, w), any positive scale; None: no depth, q = 0.
    ignore : (h, w) true where pixels count for nothing.
    s : the section ``statistics`` of the settings.

    Returns
    -------
    (slots + cells, 11, 11); element [n, 0, 0] is a number of pixels. Row 0 is the sum of the cells.
    """
    slot = slots(label, ids)
    used = slot.copy()
    used[without_borders(slot, s.border)] = UNUSED
    if backward is not None:
        lost, objects = unclosed(flow, backward, s.closure, s.closure_part), slot > 0
        if np.count_nonzero(lost & objects) > MOST * np.count_nonzero(objects):
            lost &= ~objects
        used[lost] = UNUSED
    if ignore is not None:
        used[ignore] = UNUSED
    cells = cell_grid(label.shape, s.cells_y, s.cells_x)
    slot = np.where(used == 0, len(ids) + cells, used)
    x, y = coordinates(*label.shape)
    q = np.zeros(label.shape) if inverse_depth is None else normalise(inverse_depth)
    gram = gram_matrices(slot, x, y, q, flow[0], flow[1], len(ids) + s.cells_y * s.cells_x)
    gram[0] = gram[len(ids) :].sum(0)
    return np.asarray(gram)


def slots(label: NDArray[np.integer[Any]], ids: NDArray[np.int64]) -> NDArray[np.int32]:
    """(h, w) place of every label in ``ids``; labels that are not there count for nothing."""
    table = np.full(max(int(label.max(initial=0)), int(ids[-1])) + 1, UNUSED, np.int32)
    table[ids] = np.arange(len(ids))
    return np.asarray(table[label])


def cell_grid(shape: tuple[int, ...], rows: int, columns: int) -> NDArray[np.int32]:
    """(h, w) number of the cell of a rows x columns grid that a pixel lies in."""
    height, width = shape
    row = np.arange(height) * rows // height
    column = np.arange(width) * columns // width
    return (row[:, None] * columns + column).astype(np.int32)


def without_borders(slot: NDArray[np.int32], radius: int) -> NDArray[np.bool_]:
    """(h, w) true within ``radius`` px of a boundary between objects.

    Flow and mask belong to different things there. An object that would lose more than three quarters of its
    pixels keeps them all.
    """
    if radius == 0:
        return np.zeros(slot.shape, np.bool_)
    kernel = np.ones((2 * radius + 1,) * 2, np.uint8)
    compact = (slot - UNUSED).astype(np.uint16)
    border = cv2.dilate(compact, kernel) != cv2.erode(compact, kernel)
    before = np.bincount(compact.ravel())
    lost = np.bincount(compact[border], minlength=len(before))
    return np.asarray(border & (lost <= 0.75 * before)[compact])


def unclosed(
    flow: NDArray[np.float32], backward: NDArray[np.float32], closure: float, part: float
) -> NDArray[np.bool_]:
    """(h, w) true where the flow does not lead back: hidden in the next frame, or wrong, as beside a fast thing.

    Parameters
    ----------
    flow, backward : (2, h, w) px.
    closure, part : px, and part of the length of the flow, that it may miss its start by.
    """
    height, width = flow.shape[1:]
    to_x = flow[0] + np.arange(width, dtype=np.float32)
    to_y = flow[1] + np.arange(height, dtype=np.float32)[:, None]
    u, v = (
        f + cv2.remap(b, to_x, to_y, cv2.INTER_LINEAR, borderValue=FAR)
        for f, b in zip(flow, backward, strict=True)
    )
    limit = closure + part * cv2.magnitude(*flow)
    return np.asarray(~(cv2.magnitude(u, v) <= limit))
