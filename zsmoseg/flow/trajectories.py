"""Points followed along dense flow, as long as the flow backward agrees; new ones where none is left.

Sundaram, Brox, Keutzer, "Dense point trajectories by GPU-accelerated large displacement optical flow", ECCV 2010.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow, Places, Tolerance, closed, round_trip_of

Ids = NDArray[np.int64]
Pair = tuple[Flow, Flow] | None
"""Flow forward and backward (2, h, w), x then y, px, NaN = unknown; None at a cut, where all tracks end."""

AGREE = Tolerance(absolute=0.5, relative=0.01, rule="squares")
"""The values of Sundaram, Brox, Keutzer."""


@dataclass(frozen=True)
class Tracks:
    """Where the tracks are: a row for each track and frame, by frame and then by track."""

    track: Ids
    """(rows,) number of the track, by its first frame."""
    frame: Ids
    """(rows,) ascending."""
    place: Places
    """(rows, 2) x, y px."""

    def at(self, frame: int) -> slice:
        """The rows of a frame."""
        return slice(*np.searchsorted(self.frame, [frame, frame + 1]).tolist())

    def both(self, first: int, second: int) -> tuple[Ids, Ids]:
        """Rows of the tracks that are seen in both frames, in the one and in the other."""
        a, b = self.at(first), self.at(second)
        _, i, j = np.intersect1d(self.track[a], self.track[b], assume_unique=True, return_indices=True)
        return i + a.start, j + b.start


def follow(pairs: Iterable[Pair], height: int, width: int, spacing: int) -> Tracks:
    """Tracks through the frames that ``pairs`` join; see ``each_frame``."""
    found = list(each_frame(pairs, height, width, spacing))
    frames = np.repeat(np.arange(len(found)), [len(t) for t, _ in found])
    return Tracks(np.concatenate([t for t, _ in found]), frames, np.concatenate([p for _, p in found]))


def each_frame(pairs: Iterable[Pair], height: int, width: int, spacing: int) -> Iterator[tuple[Ids, Places]]:
    """The tracks that are at each frame, (points,) numbers, and where, (points, 2) x, y px; one pair in memory at a time.

    Parameters
    ----------
    pairs : the flow of every pair of frames.
    spacing : px; a track starts at the centre of each cell of this size that holds none.

    Notes
    -----
    A track ends where it leaves the frame or where forward and backward disagree. Of tracks that meet in one pixel the older
    goes on.
    """
    grid = _centres(height, width, spacing)
    track, place, last = np.arange(len(grid)), grid, len(grid)
    yield track, place
    for pair in pairs:
        if pair is None:
            track, place = track[:0], place[:0]
        else:
            end, good = _step(place, *pair)
            track, place = _unmet(track[good], end[good], width)
        new = _lacking(grid, place, height, width, spacing)
        track = np.concatenate([track, last + np.arange(len(new))])
        place, last = np.concatenate([place, new]), last + len(new)
        yield track, place


def look_up(label: NDArray[np.integer[Any]], place: Places) -> Ids:
    """The label (h, w) of the pixel nearest to each place (rows, 2)."""
    x, y = np.rint(place).astype(np.int64).T
    height, width = label.shape
    return np.asarray(label[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], np.int64)


def _step(place: Places, forward: Flow, backward: Flow) -> tuple[Places, NDArray[np.bool_]]:
    """Where the points (rows, 2) are in the next frame, and whether to believe it."""
    trip = round_trip_of(place.T, forward, backward)
    return np.ascontiguousarray(trip.end.T), trip.inside & closed(trip, AGREE)


def _unmet(track: Ids, place: Places, width: int) -> tuple[Ids, Places]:
    pixel = np.rint(place).astype(np.int64) @ [1, width]
    keep = np.sort(np.unique(pixel, return_index=True)[1])
    return track[keep], place[keep]


def _centres(height: int, width: int, spacing: int) -> Places:
    """One in each cell, in the order of the cells; in a cell that the border cuts, within the frame."""
    y, x = (np.minimum(np.arange(0, n, spacing) + spacing // 2, n - 1) for n in (height, width))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float32)


def _lacking(grid: Places, place: Places, height: int, width: int, spacing: int) -> Places:
    """The centres of the cells without a point."""
    columns = -(-width // spacing)
    cell = (place // spacing).astype(np.int64) @ [1, columns]
    free: NDArray[np.bool_] = np.bincount(cell, minlength=len(grid)) == 0
    return np.asarray(grid[free])
