"""Stage ``epipolar``: how well the two-view geometry of each object explains the tracks of each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.trajectories import Tracks, look_up
from zsmoseg.grouping.epipolar import epipolar_residuals
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, shrink
from zsmoseg.workflows.stages.motion.trajectories import Trajectories
from zsmoseg.workflows.stages.windows import LENGTH, all_windows, block_of

Floats = NDArray[np.float64]
Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Epipolar(Arrays):
    """Residuals of pairs of frames some frames apart, by gap, then by start; a block is a window of a shot."""

    object: Ids = table("object", dtype="int64", meaning="object")
    first: Ids = table("view_pair", dtype="int64", meaning="first frame of the two")
    gap: Ids = table("view_pair", dtype="int64", meaning="frames between the two", unit="frames")
    residual: Floats = table(
        "view_pair",
        "model",
        "object",
        dtype="float64",
        meaning="squared distance of the points of one object from the geometry of another",
        unit="px^2",
    )
    points: Floats = table(
        "view_pair", "object", dtype="float64", meaning="number of tracks, 0 where unseen", fill=0
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    trajectories: Trajectories = reach(ALL)
    labels: Labels = reach(ALL)
    objects: Objects = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    trajectories: settings.Trajectories


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Epipolar]:
    """The residuals of every window of every shot, over all its objects."""
    grid = working_size(part.probe, s.frames.width)
    for shot in all_windows(inputs.objects, inputs.labels):
        tracks, count = inputs.trajectories.of(shot.start, shot.stop).tracks(), len(shot.objects)
        found = list(
            epipolar_residuals(tracks, _labels(inputs.labels, shot, tracks, grid), s.trajectories.gaps)
        )
        residual, points = np.full((len(found), count, count), np.nan), np.zeros((len(found), count))
        for k, pair in enumerate(found):
            residual[k][np.ix_(pair.ids, pair.ids)] = pair.residual
            points[k, pair.ids] = pair.points
        yield Epipolar(
            start=shot.start,
            stop=shot.stop,
            object=shot.objects,
            first=np.array([shot.start + pair.start for pair in found], np.int64),
            gap=np.array([pair.gap for pair in found], np.int64),
            residual=residual,
            points=points,
        )


def _labels(labels: Labels, shot: Shot, tracks: Tracks, grid: tuple[int, int]) -> Ids:
    """(rows,) the object that each point is on, by its number within the shot."""
    found = []
    for t in range(shot.stop - shot.start):
        frame = shot.start + t
        (label,) = shrink(labels.of(frame, frame + 1).label, *grid)
        found.append(look_up(label, tracks.place[tracks.at(t)]))
    return np.searchsorted(shot.objects, np.concatenate(found))


def each_view_pair(epipolar: Epipolar, shot: Shot) -> Iterator[tuple[Ids, Floats, Floats]]:
    """Local ids, residuals and numbers of points of the pairs of a window, in order."""
    block = block_of(epipolar, shot)
    for residual, points in zip(block.residual, block.points, strict=True):
        ids = np.flatnonzero(points > 0)
        yield ids, residual[np.ix_(ids, ids)], points[ids]


STAGE = Stage(
    "epipolar",
    3,
    task,
    Inputs,
    Sections,
    Epipolar,
    "video",
    cost=(10.0, 4.0),
    memory=Memory(working=1, frames=lambda s: LENGTH),
)
