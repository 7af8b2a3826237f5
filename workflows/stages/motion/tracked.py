"""The tracks of a window as the look at the geometry wants them: with the object that each is on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.trajectories import each_frame, look_up
from zsmoseg.grouping.geometry import EVERY, SPACING, Seen
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.front_end import Labels, Shot, shrink


def tracked(
    flow: Flow, labels: Labels, shot: Shot, grid: tuple[int, int], ignore: NDArray[np.bool_] | None
) -> Iterator[Seen]:
    """The tracks that are at every ``EVERY``-th frame, objects by their number within the shot; a few in memory at a time.

    Parameters
    ----------
    grid : height and width of the working grid.
    ignore : (h, w) true where pixels count for nothing, and so do tracks; None: all count.
    """
    found = each_frame(flow.each_pair(shot.start, shot.stop - 1), *grid, SPACING)
    for frame, (track, place) in enumerate(found, start=shot.start):
        if (frame - shot.start) % EVERY == 0:
            (label,) = shrink(labels.of(frame, frame + 1).label, *grid)
            on = np.searchsorted(shot.objects, look_up(label, place))
            counts = slice(None) if ignore is None else look_up(ignore.astype(np.uint8), place) == 0
            yield track[counts], place[counts], on[counts]
