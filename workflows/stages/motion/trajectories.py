"""Stage ``trajectories``: points followed along the flow, shot by shot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.trajectories import Tracks, each_frame
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts

BLOCK = 16
"""Frames that are written at once."""


@dataclass(frozen=True)
class Trajectories(Arrays):
    """The points of all frames one after the other."""

    points: NDArray[np.int64] = table("frame", dtype="int64", meaning="number of points")
    track: NDArray[np.int64] = table("point", dtype="int64", meaning="number of the track within its shot")
    place: NDArray[np.float32] = table(
        "point", "component", dtype="float32", meaning="place of the point, x then y", unit="px"
    )

    def tracks(self) -> Tracks:
        """The tracks through these frames, of one shot; its first frame is 0."""
        found = []
        for block in self.blocks():
            frame = np.repeat(np.arange(block.start, block.stop), block.points)
            inside = slice(*np.searchsorted(frame, [self.start, self.stop]))
            found.append((block.track[inside], frame[inside] - self.start, block.place[inside]))
        track, at, place = (np.concatenate(column) for column in zip(*found, strict=True))
        return Tracks(track, at, place)


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
        found = each_frame(inputs.flow.each_pair(start, stop - 1), *grid, s.trajectories.spacing)
        for at in range(start, stop, BLOCK):
            some = list(islice(found, BLOCK))
            track, place = (np.concatenate(column) for column in zip(*some, strict=True))
            points = np.array([len(numbers) for numbers, _ in some], np.int64)
            yield Trajectories(start=at, stop=at + len(some), points=points, track=track, place=place)


STAGE = Stage(
    "trajectories",
    3,
    task,
    Inputs,
    Sections,
    Trajectories,
    "video",
    cost=(2.0, 16.0),
    memory=Memory(working=150, frames=lambda s: 1),
)
