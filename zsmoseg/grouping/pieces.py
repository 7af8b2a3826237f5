"""Where the objects of a shot are seen, and in which colours."""

# mypy: disable-error-code="untyped-decorator, operator"
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.motion.statistics import slots

LIGHT, HUES = 8, 6
BINS = (LIGHT, HUES, HUES)
"""Of the colour histogram: L, a, b."""
LEVELS = 256
"""Of L, a and b, 8 bit."""
FIRST, STEP = 80, 16
"""First value of a and b, and width of a bin: the colours of most pictures are within 48 of grey, which is 128;
stronger ones fall into the outer bins."""


@dataclass(frozen=True)
class Pieces:
    """Where T frames show N objects (by slot) and in which colours."""

    area: NDArray[np.int32]
    """(T, N) px of the working grid; 0 = absent."""
    box: NDArray[np.float32]
    """(T, N, 4) x0, y0, x1, y1 px, end exclusive; NaN = absent."""
    colour: NDArray[np.int64]
    """(N, bins) px."""


def measure_pieces(label: NDArray[np.integer], frames: NDArray[np.uint8], ids: NDArray[np.int64]) -> Pieces:
    """Place and colour of the objects ``ids``.

    Parameters
    ----------
    label : (T, h, w) object of every pixel.
    frames : (T, h, w, 3) blue green red.
    ids : (N,) ascending, 0 first; all that occur in ``label``.
    """
    count = len(ids)
    area = np.zeros((len(label), count), np.int32)
    box = np.full((len(label), count, 4), np.nan, np.float32)
    colour = np.zeros((count, int(np.prod(BINS))), np.int64)
    for t, (one, frame) in enumerate(zip(label, frames, strict=True)):
        area[t], box[t] = _measure(slots(one, ids), cv2.cvtColor(frame, cv2.COLOR_BGR2LAB), colour)
    return Pieces(area, box, colour)


@compiled
def _measure(
    slot: NDArray[Any], lab: NDArray[Any], colour: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
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
            code = np.int64(lab[y, x, 0]) * LIGHT // LEVELS
            for c in range(1, 3):
                part = (np.int64(lab[y, x, c]) - FIRST) // STEP
                code = code * HUES + min(max(part, 0), HUES - 1)
            colour[n, code] += 1
            if np.isnan(box[n, 0]):
                box[n, 0], box[n, 1], box[n, 2], box[n, 3] = x, y, x + 1, y + 1
            else:
                box[n, 0], box[n, 2] = min(box[n, 0], x), max(box[n, 2], x + 1)
                box[n, 3] = y + 1
    return area, box
