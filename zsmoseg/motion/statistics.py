"""The one pass over the pixels: sums of products of which every model, residual and joint fit is made.

Row n of the result is the Gram matrix of (1, x, y, q, xq, yq, x^2, xy, y^2, u, v) over the pixels of object n.
Grams of disjoint sets add. The background is cut into a fixed grid of cells besides: pieces of the static world
as large as an object, seen through the same flow and depth; they are the yardstick of the decision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow, Tolerance, closed, round_trip
from zsmoseg.motion.grams import gram_matrices
from zsmoseg.motion.models import Floats, coordinates, normalise

Slots = NDArray[np.int32]
UNUSED = -1
"""Slot of pixels that count for nothing."""
MOST = 0.95
"""Part of all objects' pixels from which on a lacking way back tells nothing of them: no flow closes on them."""
EATEN = 0.75
"""Part of its pixels that an object may lose to its border; thinner ones keep theirs."""


@dataclass(frozen=True)
class Sums:
    """Which pixels are summed, and into which cells."""

    border: int
    """px to a boundary between objects within which pixels are left out."""
    closure: float
    """px that the flow backward may miss the start of the flow forward by ..."""
    closure_part: float
    """... plus this part of the flow's length."""
    cells_y: int
    """Rows of the grid of background cells."""
    cells_x: int
    """Columns of the grid of background cells."""


def pair_sums(
    slot: Slots,
    count: int,
    forward: Flow,
    backward: Flow | None,
    inverse_depth: NDArray[np.floating] | None,
    ignore: NDArray[np.bool_] | None,
    parameters: Sums,
) -> Floats:
    """Gram matrices of one pair, of ``count`` objects and then of the cells.

    Parameters
    ----------
    slot : (h, w) object of every pixel on the working grid, 0 = background, below 0 = none.
    forward, backward : (2, h, w) px, NaN = unknown; backward None: the flow forward is right everywhere.
    inverse_depth : (h, w), any positive scale; None: no depth, q = 0.
    ignore : (h, w) true where pixels count for nothing.

    Returns
    -------
    (count + cells, 11, 11); element [n, 0, 0] is a number of pixels. Row 0 is the sum of the cells.
    """
    used = slot.copy()
    used[without_borders(slot, parameters.border)] = UNUSED
    if backward is not None:
        used[_unclosed(forward, backward, slot > 0, parameters)] = UNUSED
    if ignore is not None:
        used[ignore] = UNUSED
    rows, columns = parameters.cells_y, parameters.cells_x
    used = np.where(used == 0, count + cell_grid(slot.shape, rows, columns), used)
    x, y = coordinates(*slot.shape)
    q = np.zeros(slot.shape) if inverse_depth is None else normalise(inverse_depth)
    gram = np.asarray(gram_matrices(used, x, y, q, forward[0], forward[1], count + rows * columns))
    gram[0] = gram[count:].sum(0)
    return gram


def slots(label: NDArray[np.integer[Any]], ids: NDArray[np.int64]) -> Slots:
    """(h, w) place of every label in ``ids``; labels that are not there count for nothing."""
    table = np.full(max(int(label.max(initial=0)), int(ids[-1])) + 1, UNUSED, np.int32)
    table[ids] = np.arange(len(ids))
    return np.asarray(table[label])


def cell_grid(shape: tuple[int, ...], rows: int, columns: int) -> Slots:
    """(h, w) number of the cell of a rows x columns grid that a pixel lies in."""
    height, width = shape
    row = np.arange(height) * rows // height
    column = np.arange(width) * columns // width
    return (row[:, None] * columns + column).astype(np.int32)


def without_borders(slot: Slots, radius: int) -> NDArray[np.bool_]:
    """(h, w) true within ``radius`` px of a boundary between objects.

    Flow and mask belong to different objects there. An object that would lose more than three quarters of its
    pixels keeps them all.
    """
    if radius == 0:
        return np.zeros(slot.shape, np.bool_)
    kernel = np.ones((2 * radius + 1,) * 2, np.uint8)
    compact = (slot - UNUSED).astype(np.uint16)
    border = cv2.dilate(compact, kernel) != cv2.erode(compact, kernel)
    before = np.bincount(compact.ravel())
    lost = np.bincount(compact[border], minlength=len(before))
    return np.asarray(border & (lost <= EATEN * before)[compact])


def _unclosed(
    forward: Flow, backward: Flow, objects: NDArray[np.bool_], parameters: Sums
) -> NDArray[np.bool_]:
    """(h, w) true where the flow does not lead back: hidden in the next frame, or wrong, as beside something fast.

    Where it leads back on none of the ``objects`` (h, w), all of those keep their pixels.
    """
    tolerance = Tolerance(parameters.closure, parameters.closure_part, "sum")
    lost = ~closed(round_trip(forward, backward), tolerance)
    if np.count_nonzero(lost & objects) > MOST * np.count_nonzero(objects):
        lost &= ~objects
    return np.asarray(lost)
