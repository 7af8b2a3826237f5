"""The one pass over the pixels: sums of products of which every model, residual and joint fit is made.

Row n of the result is the Gram matrix of (1, x, y, q, xq, yq, x^2, xy, y^2, u, v) over the pixels of object n.
Grams of disjoint sets add. What counts for nothing has no slot: pixels beside a boundary between objects, pixels whose
flow does not lead back, pixels that are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow, Tolerance, closed, round_trip
from zsmoseg.motion.grams import gram_matrices
from zsmoseg.motion.models import LEAST, Floats, U, V, coordinates, normalise, pixels_of

Slots = NDArray[np.int32]
UNUSED = -1
"""Slot of pixels that count for nothing."""
MOST = 0.95
"""Part of all objects' pixels from which on a lacking way back tells nothing of them: no flow closes on them."""
EATEN = 0.75
"""Part of its pixels that an object may lose to its border; thinner ones keep theirs."""


@dataclass(frozen=True)
class Sums:
    """Which pixels are summed."""

    border: int
    """px to a boundary between objects within which pixels are left out."""
    closure: float
    """px that the flow backward may miss the start of the flow forward by ..."""
    closure_part: float
    """... plus this part of the flow's length."""
    noise_lag: int
    """px over which the error of the flow is taken as independent."""


def used_slots(
    slot: Slots,
    forward: Flow,
    backward: Flow | None,
    ignore: NDArray[np.bool_] | None,
    parameters: Sums,
) -> Slots:
    """(h, w) the slots of the pixels that count, ``UNUSED`` elsewhere.

    Parameters
    ----------
    slot : (h, w) object of every pixel on the working grid, 0 = background, below 0 = none.
    forward, backward : (2, h, w) px, NaN = unknown; backward None: the flow forward is right everywhere.
    ignore : (h, w) true where pixels count for nothing.
    """
    used = slot.copy()
    used[without_borders(slot, parameters.border)] = UNUSED
    if backward is not None:
        used[_unclosed(forward, backward, slot > 0, parameters)] = UNUSED
    if ignore is not None:
        used[ignore] = UNUSED
    return used


def pair_sums(used: Slots, count: int, forward: Flow, inverse_depth: NDArray[np.floating] | None) -> Floats:
    """Gram matrices (count, 11, 11) of the objects of one pair; element [n, 0, 0] is a number of pixels.

    Parameters
    ----------
    used : (h, w) as ``used_slots`` gives them.
    forward : (2, h, w) px, NaN = unknown.
    inverse_depth : (h, w), any positive scale; None: no depth, q = 0.
    """
    x, y = coordinates(*used.shape)
    q = np.zeros(used.shape) if inverse_depth is None else normalise(inverse_depth)
    return np.asarray(gram_matrices(used, x, y, q, forward[0], forward[1], count))


def mean_flow(gram: Floats) -> Floats:
    """(S, 2) x, y px: mean flow of the objects with the Grams (S, 11, 11); NaN of those with too few pixels."""
    pixels = pixels_of(gram)[:, None]
    seen = pixels >= LEAST
    return np.where(seen, gram[:, 0, U : V + 1] / np.where(seen, pixels, 1.0), np.nan)


def slots(label: NDArray[np.integer[Any]], ids: NDArray[np.int64]) -> Slots:
    """(h, w) place of every label in ``ids``; labels that are not there count for nothing."""
    table = np.full(max(int(label.max(initial=0)), int(ids[-1])) + 1, UNUSED, np.int32)
    table[ids] = np.arange(len(ids))
    return np.asarray(table[label])


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
