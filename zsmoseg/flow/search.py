"""Flow of what is small and moves far: all displacements are tried where the flow found does not explain the picture.

From coarse to fine, flow loses what is smaller than a patch on the level on which its motion is as short as a patch:
the patch sees what lies around it, and finer levels do not come back. Brox and Malik, "Large displacement optical
flow", PAMI 2011, match descriptors beside the pyramid for it. Here blocks of small pictures are compared, only where
the flow takes the picture to other colours, and what leads back is where the fine search begins
anew.
"""

# mypy: disable-error-code="untyped-decorator, operator"
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.flow.consistency import Flow, Tolerance, closed, round_trip

Grey = NDArray[np.uint8]
Field = NDArray[np.float32]
"""(H, W, 2) x, y in px: flow as OpenCV has it."""
Cells = NDArray[np.float32]
"""(h, w) of the small pictures."""
Things = NDArray[np.int32]
"""(h, w) which cell belongs to which thing; 0 = none."""
Box = tuple[slice, slice]
"""Rows and columns of a frame."""
Search = Callable[[Grey, Grey, Field], Field]
"""Flow from a first frame to a second, beginning with a given one."""

CELL = 4
"""px of the frame in one cell of the pictures that are compared."""
HALF = 2
"""Cells of a block on each side of the one in its middle."""
MEAN = 9
"""Cells, side of the square whose mean is taken off: light that changes is no motion."""
CAP = 40.0
"""Grey levels from which a difference of cells counts no more: a block at a border sees two things."""
LOST = 10.0
"""Mean grey levels of a block from which flow does not explain it."""
BETTER = 0.9
"""Part of that difference that another displacement must come down to: it is in whole cells, so most of it may be left."""
ALIKE = 1.5
"""Cells by which one may differ from the median of the 5 x 5 around it: chance matches do not agree."""
LEADS_BACK = Tolerance(absolute=1.0, relative=0.05, rule="larger")
"""px by which flow that was found again may miss where it began."""
LEAST = 24
"""Cells of a thing: 384 px."""
MOST = 0.1
"""Part of the picture above which nothing is tried: it is another shot, or the camera moves that fast."""
BORDER = 32
"""px around things and where they come to that the fine search sees."""
SURE = 0.5
"""Part of the difference of a thing that may be left when the fine search has begun where it was found."""
MARGIN = 2
"""Cells around a thing that its new flow is taken for as well, where it explains them no worse."""


def found_again(
    one: Grey, two: Grey, forward: Field, backward: Field, reach: int, search: Search
) -> tuple[Field, Field]:
    """Flow forward and backward between two frames, with that of what they lost.

    Parameters
    ----------
    one, two : grey frames (H, W).
    forward, backward : px, the flow between them.
    reach : px up to which displacements are tried.
    """
    cells = _small(one), _small(two)
    there, things_there = _again((one, two), cells, forward, reach, search)
    back, things_back = _again((two, one), cells[::-1], backward, reach, search)
    return (
        _that_lead_back(forward, there, things_there, back),
        _that_lead_back(backward, back, things_back, there),
    )


def _small(grey: Grey) -> Cells:
    """What is compared of a frame."""
    height, width = (max(1, n // CELL) for n in grey.shape)
    cells = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cells - cv2.blur(cells, (MEAN, MEAN)), np.float32)


def _in_cells(flow: Field, shape: tuple[int, ...]) -> Flow:
    """(2, h, w) cells."""
    cells = cv2.resize(flow, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.moveaxis(cells / np.float32(CELL), 2, 0)


def _in_px(cells: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Each px the value of its cell."""
    return np.asarray(cv2.resize(cells, shape[1::-1], interpolation=cv2.INTER_NEAREST))


def _difference(first: Cells, second: Cells, flow: Flow) -> Cells:
    """Mean difference of the block around each cell along a flow; 0 where that leads out of the picture."""
    trip = round_trip(flow, flow)
    x, y = trip.end
    there = cv2.remap(second, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    differences = np.minimum(np.abs(first - there), np.float32(CAP))
    return np.where(trip.inside, cv2.blur(differences, (2 * HALF + 1,) * 2), np.float32(0))


def _large(cells: NDArray[np.bool_]) -> Things:
    """Cells that touch, if there are enough."""
    things, _ = scipy.ndimage.label(cells, np.ones((3, 3)))
    things[np.bincount(things.ravel())[things] < LEAST] = 0
    return np.asarray(things, np.int32)


def _elsewhere(first: Cells, second: Cells, flow: Flow, lost: Cells, reach: int) -> Flow:
    """The flow; another displacement where that takes what is lost to more alike blocks, and neighbours agree."""
    wanted = lost > 0
    if not 0 < np.count_nonzero(wanted) <= MOST * wanted.size:
        return flow
    around = np.pad(second, HALF + reach, constant_values=np.float32(np.inf))
    left, there = _nearest_block(np.pad(first, HALF, "edge"), around, wanted, reach, HALF, np.float32(CAP))
    found = left < BETTER * lost
    filled = np.where(found, there, flow)
    for axis in range(2):
        found &= np.abs(there[axis] - cv2.medianBlur(filled[axis], 5)) <= ALIKE
    return np.where(found, there, flow)


def _again(
    frames: tuple[Grey, Grey], cells: tuple[Cells, Cells], flow: Field, reach: int, search: Search
) -> tuple[Field, Things]:
    """The flow, with what a search finds that begins with things where they were found; and (H, W) which px are theirs."""
    short = _in_cells(flow, cells[0].shape)
    before = _difference(*cells, short)
    lost = np.where(_large(before > LOST) > 0, before, np.float32(0))
    there = _elsewhere(*cells, short, lost, -(-reach // CELL))
    things = _large((there != short).any(axis=0))
    if not things.any():
        return flow, np.zeros(flow.shape[:2], np.int32)
    begin = _in_px(np.ascontiguousarray(np.moveaxis(there, 0, 2)) * np.float32(CELL), flow.shape)
    box = _around(things, there, flow.shape)
    again = flow.copy()
    begin = np.where(_in_px(things, flow.shape)[..., None] > 0, begin, flow)
    again[box] = search(frames[0][box], frames[1][box], begin[box])
    after = _difference(*cells, _in_cells(again, things.shape))
    sums = [np.bincount(things.ravel(), x.ravel()) for x in (before, after)]
    things[(sums[1] > SURE * sums[0])[things]] = 0
    near = cv2.dilate(things.astype(np.float32), np.ones((2 * MARGIN + 1,) * 2))
    taken = _in_px(np.where(after <= before, near, 0).astype(np.int32), flow.shape)
    return np.where(taken[..., None] > 0, again, flow), taken


def _around(things: Things, there: Flow, shape: tuple[int, ...]) -> Box:
    """Rows and columns of the frame that hold the things and where they come to."""
    places = np.argwhere(things)
    come = places + there[::-1, *places.T].T
    both = np.concatenate([places, come]) * CELL
    low = np.maximum(both.min(axis=0).astype(int) - BORDER, 0)
    high = np.minimum(both.max(axis=0).astype(int) + CELL + BORDER, shape[:2])
    return slice(low[0], high[0]), slice(low[1], high[1])


def _that_lead_back(flow: Field, again: Field, things: Things, back: Field) -> Field:
    """The flow, with that of ``again`` for the things half of which the flow back brings to where they were.

    By chance, what is hidden in the other frame looks like something there; that does not look back.
    """
    if not things.any():
        return flow
    leads = closed(round_trip(np.moveaxis(again, 2, 0), np.moveaxis(back, 2, 0)), LEADS_BACK)
    size = np.bincount(things.ravel())
    kept = 2 * np.bincount(things.ravel(), leads.ravel()) > size
    kept[0] = False
    return np.where(kept[things][..., None], again, flow)


@compiled
def _nearest_block(
    first: NDArray[Any], second: NDArray[Any], wanted: NDArray[Any], reach: int, half: int, cap: Any
) -> tuple[NDArray[Any], NDArray[Any]]:
    """(h, w) least mean difference of two blocks, and (2, h, w) the displacement; ``first`` and ``second`` have borders.

    Every second cell along both axes is searched, and speaks for the three that follow it.
    """
    height, width = wanted.shape
    side = 2 * half + 1
    least = np.full((height, width), np.inf, np.float32)
    there = np.zeros((2, height, width), np.float32)
    for y in range(0, height, 2):
        for x in range(0, width, 2):
            if not wanted[y : y + 2, x : x + 2].any():
                continue
            best = np.float32(cap * side * side)
            for dy in range(2 * reach + 1):
                for dx in range(2 * reach + 1):
                    total = np.float32(0)
                    for i in range(side):
                        for j in range(side):
                            total += min(abs(first[y + i, x + j] - second[y + i + dy, x + j + dx]), cap)
                        if total >= best:
                            break
                    if total < best:
                        best = total
                        there[0, y : y + 2, x : x + 2] = dx - reach
                        there[1, y : y + 2, x : x + 2] = dy - reach
            least[y : y + 2, x : x + 2] = best / np.float32(side * side)
    return least, there
