"""Objects that are one thing: an id that broke and came back, a limb that came off.

Objects are near by place, time and colour; one goes on in another where it ends beside it in the open. The
decision is made on the objects; what linking adds is which of the movers are one thing, and which objects with too
little evidence of their own belong to a thing that moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.motion.loops import measure_pieces_of
from zsmoseg.motion.models import Floats
from zsmoseg.motion.statistics import slots

BINS = (8, 6, 6)
"""Of the colour histogram: L, a, b."""


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
    """Place and colour of the objects ``ids`` (N, ascending, 0 first) in ``label`` (T, h, w), ``frames`` (T, h, w, 3)."""
    count = len(ids)
    area = np.zeros((len(label), count), np.int32)
    box = np.full((len(label), count, 4), np.nan, np.float32)
    colour = np.zeros((count, int(np.prod(BINS))), np.int64)
    for t, (one, frame) in enumerate(zip(label, frames, strict=True)):
        slot = slots(one, ids)
        area[t], box[t] = measure_pieces_of(slot, cv2.cvtColor(frame, cv2.COLOR_BGR2LAB), colour)
    return Pieces(area, box, colour)


def box_gap(a: Floats, b: Floats) -> Floats:
    """Distance between boxes (..., 4), 0 where they overlap."""
    d = np.maximum(np.maximum(a[..., :2] - b[..., 2:], b[..., :2] - a[..., 2:]), 0.0)
    return np.hypot(d[..., 0], d[..., 1])


@dataclass(frozen=True)
class Nearness:
    """(N, N) distance in units of what is allowed, at most 1 = near; (N, N) whether one goes on in the other."""

    distance: Floats
    goes_on: NDArray[np.bool_]


def nearness(pieces: Pieces, velocity: Floats, shape: tuple[int, int], s: settings.Groups) -> Nearness:
    """Which objects can be one thing.

    Seen together: the median distance of their boxes over the common frames. Never together: the earlier box moved
    on by its last velocity, or the later one back by its first, the better counts; at most ``gap`` frames apart,
    and over unseen frames the colours must agree. The unit is ``reach`` times the root of the larger area.

    Parameters
    ----------
    velocity : (2, N, 2) px a frame, of the first and of the last pairs of every object.
    shape : height and width of the working grid.
    """
    count = pieces.area.shape[1]
    seen = pieces.area > 0
    distance, goes_on = np.full((count, count), np.inf), np.zeros((count, count), np.bool_)
    present = [n for n in range(1, count) if seen[:, n].any()]
    first = seen.argmax(0)
    last = len(seen) - 1 - seen[::-1].argmax(0)
    size = np.array([np.sqrt(np.median(a[a > 0])) if (a > 0).any() else 0.0 for a in pieces.area.T])
    colour = pieces.colour / np.maximum(pieces.colour.sum(1, keepdims=True), 1)
    box = pieces.box.astype(np.float64)
    frame = np.array([1.0, 1.0, shape[1] - 1.0, shape[0] - 1.0])

    def inside(b: Floats) -> bool:
        return bool((b[:2] > frame[:2]).all() and (b[2:] < frame[2:]).all())

    def ends_beside(a: int, b: int, limit: float) -> bool:
        for t, other in ((first[a], first[a] - 1), (last[a], last[a] + 1)):
            open_end = 0 <= other < len(seen) and seen[other, b] and inside(box[t, a])
            if open_end and box_gap(box[t, a], box[other, b]) <= limit:
                return True
        return False

    for at, i in enumerate(present):
        for j in present[at + 1 :]:
            limit = s.reach * max(size[i], size[j])
            common = seen[:, i] & seen[:, j]
            if common.any():
                gap = float(np.median(box_gap(box[common, i], box[common, j])))
                short = common.sum() <= s.overlap * min(seen[:, i].sum(), seen[:, j].sum())
                if short and np.minimum(colour[i], colour[j]).sum() >= s.colour:
                    goes_on[i, j] = goes_on[j, i] = ends_beside(i, j, limit) or ends_beside(j, i, limit)
            else:
                a, b = (i, j) if last[i] < first[j] else (j, i)
                frames = first[b] - last[a]
                if not 0 < frames <= s.gap:
                    continue
                if frames > 1 and np.minimum(colour[i], colour[j]).sum() < s.colour:
                    continue
                end, start = box[last[a], a], box[first[b], b]
                on, back = (frames * np.tile(v, 2) for v in (velocity[1, a], velocity[0, b]))
                gap = float(min(box_gap(end + on, start), box_gap(end, start - back)))
                goes_on[i, j] = goes_on[j, i] = gap <= limit
            distance[i, j] = distance[j, i] = gap / max(limit, 1e-9)
    return Nearness(distance, goes_on)
