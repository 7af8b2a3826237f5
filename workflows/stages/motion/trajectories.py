"""Stage ``trajectories``: points followed along the flow, shot by shot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.trajectories import Tracks, follow
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts


@dataclass(frozen=True)
class Trajectories(Arrays):
    """The points of all frames one after the other; a block is a shot."""

    points: NDArray[np.int64] = table("frame", dtype="int64", meaning="number of points")
    track: NDArray[np.int64] = table("point", dtype="int64", meaning="number of the track within its shot")
    place: NDArray[np.float32] = table(
        "point", "component", dtype="float32", meaning="place of the point, x then y", unit="px"
    )

    def tracks(self) -> Tracks:
        """The tracks of one block."""
        frame = np.repeat(np.arange(len(self.points)), self.points)
        return Tracks(self.track, frame, self.place)


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    trajectories: settings.Trajectories


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Trajectories]:
    """The tracks of every shot."""
    grid = working_size(part.probe, s.frames.width)
    for start, stop in between_cuts(inputs.flow.state):
        pairs = (inputs.flow.of(m, m + 1) for m in range(start, stop - 1))
        tracks = follow(((p.forward[0], p.backward[0]) for p in pairs), *grid, s.trajectories.spacing)
        points = np.bincount(tracks.frame, minlength=stop - start)
        yield Trajectories(start=start, stop=stop, points=points, track=tracks.track, place=tracks.place)


STAGE = Stage("trajectories", 2, task, Inputs, Sections, Trajectories, "video", cost=(2.0, 16.0))
