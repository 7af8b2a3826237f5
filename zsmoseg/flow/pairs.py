"""Whether two frames that follow each other are a pair at all: of one shot, and not the same frame twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow, Tolerance, closed, round_trip
from zsmoseg.flow.warp import read_at

PairState = Literal["ok", "cut", "repeat"]
OK, CUT, REPEAT = range(3)
STATES: tuple[PairState, ...] = ("ok", "cut", "repeat")
"""Name of each state; stored is its index."""

WINDOW = 7
"""px, side of the squares whose means a repeat keeps: noise and the traces of a codec vanish in the mean, what is small
and moves does not."""
FEW = 0.001
"""Part of the squares that may differ by up to twice as much: a codec spoils single blocks."""
COARSER = 4
"""px of the frame in one of the grid that is looked at: cuts are seen on thumbnails, and detail only adds noise."""
LEADS_BACK = Tolerance(absolute=1.0, relative=0.2, rule="larger")
"""Generous: fast motion within a shot has poor flow, over a cut it has none."""
CHANGED_PART, CHANGED_LEAST, CHANGED_MOST = 0.25, 4.0, 12.0
"""Difference from which a colour is another: part of the spread of the frame's colours, within grey levels."""


@dataclass(frozen=True)
class PairCriteria:
    """What tells a cut and a repeat from a pair."""

    cut: float
    """Share of the pixels that the other frame does not explain above which a pair is a cut."""
    repeat: float
    """Grey levels of difference of local means up to which a frame is a repeat of the one before."""


def pair_state(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    forward: Flow,
    backward: Flow,
    criteria: PairCriteria,
) -> PairState:
    """Whether two frames are a pair (``ok``), of different shots (``cut``), or the same frame twice (``repeat``).

    Parameters
    ----------
    first, second : frames (h, w, 3), blue green red.
    forward, backward : (2, h, w) px, the flow between them.
    """
    if _repeated(first, second, criteria.repeat):
        return "repeat"
    lost = _unexplained(first, second, forward, backward) > criteria.cut
    return "cut" if lost and _unexplained(second, first, backward, forward) > criteria.cut else "ok"


def _repeated(first: NDArray[np.uint8], second: NDArray[np.uint8], level: float) -> bool:
    """Whether squares differ in their mean by ``level`` grey levels at most, ``FEW`` of them by twice that."""
    greys = (cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32) for frame in (first, second))
    one, two = (cv2.blur(grey, (WINDOW, WINDOW)) for grey in greys)
    difference = np.abs(one - two)
    largest = float(difference.max())
    return largest <= level or (largest <= 2 * level and float((difference > level).mean()) <= FEW)


def _unexplained(first: NDArray[np.uint8], second: NDArray[np.uint8], forward: Flow, backward: Flow) -> float:
    """Share of the pixels of ``first`` that the flow takes to another colour and does not bring back.

    Both are asked for: a flash changes colours but not where objects go, and flow is lost in fast motion on one
    colour. Unknown flow is not lost: it speaks for no cut.
    """
    height, width = (max(1, n // COARSER) for n in first.shape[:2])
    one, two, ahead, behind = (
        _shrunk(image, (width, height))
        for image in (first, second, np.moveaxis(forward, 0, 2), np.moveaxis(backward, 0, 2))
    )
    trip = round_trip(np.moveaxis(ahead, 2, 0), np.moveaxis(behind, 2, 0), COARSER)
    known = np.isfinite(trip.error).all(0)
    outside = np.isfinite(trip.end).all(0) & ~trip.inside
    lost = outside | (known & ~closed(trip, LEADS_BACK))
    limit = np.clip(CHANGED_PART * one.std(), CHANGED_LEAST, CHANGED_MOST)
    found = read_at(two, *trip.end)
    return float((lost & (np.abs(one - found).max(2) > limit)).mean())


def _shrunk(image: NDArray[Any], size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w, channels) of an image at another width and height."""
    small = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)
