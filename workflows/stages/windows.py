"""Windows of long shots: what compares objects with objects sees some hundred frames at once, however long a shot is.

A shot up to ``LENGTH`` frames is one window. A longer one is cut into windows of that length that lie evenly and share
``OVERLAP`` frames or more; each answers for its frames up to the middle of what it shares. The objects of a window are
those seen in it, so that no table grows with the objects of the shot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from zsmoseg.stores.arrays import Arrays
from zsmoseg.workflows.stages.front_end import Ids, Labels, Objects, Shot, shots_of

T = TypeVar("T", bound=Arrays)

LENGTH = 600
"""Frames of a window."""
OVERLAP = 60
"""Frames that two windows share at least: an instance out of sight at a border is seen on both sides in one of them."""


@dataclass(frozen=True)
class Window(Shot):
    """A part of a shot that is looked at as if it were one, with the objects seen in it.

    Attributes
    ----------
    first, last
        The frames that it answers for: ``first`` to ``last - 1``.
    """

    first: int
    last: int


def spans_of(start: int, stop: int) -> list[tuple[int, int]]:
    """The frames (start, stop) of each window of a shot."""
    beyond = stop - start - LENGTH
    if beyond <= 0:
        return [(start, stop)]
    steps = -(-beyond // (LENGTH - OVERLAP))
    starts = [start + k * beyond // steps for k in range(steps + 1)]
    return [(a, a + LENGTH) for a in starts]


def all_windows(objects: Objects, labels: Labels) -> Iterator[Window]:
    """The windows of all shots of a video, in order."""
    for shot in shots_of(objects):
        yield from windows_of(shot, labels)


def windows_of(shot: Shot, labels: Labels) -> Iterator[Window]:
    """The windows of a shot in order; that of a short one has all its objects."""
    spans = spans_of(shot.start, shot.stop)
    borders = [shot.start, *((b + c) // 2 for (_, b), (c, _) in pairwise(spans)), shot.stop]
    for (start, stop), (first, last) in zip(spans, pairwise(borders), strict=True):
        objects = shot.objects if len(spans) == 1 else _seen(shot, labels, start, stop)
        yield Window(shot.number, start, stop, objects, first, last)


def _seen(shot: Shot, labels: Labels, start: int, stop: int) -> Ids:
    """The objects of the shot that the frames ``start`` to ``stop - 1`` show, the background first."""
    found = [np.zeros(1, np.int64)]
    for block in labels.of(start, stop).blocks():
        rows = slice(max(start - block.start, 0), stop - block.start)
        found.append(block.object[(block.area[rows] > 0).any(0)])
    return np.intersect1d(np.concatenate(found), shot.objects)


def block_of(arrays: T, window: Shot) -> T:
    """What a stage that leaves a block a window has left of one; shots of one window count as such."""
    found = arrays.of(window.start, window.stop).blocks()
    return next(b for b in found if (b.start, b.stop) == (window.start, window.stop))
