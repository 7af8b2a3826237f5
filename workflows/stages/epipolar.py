"""Stage ``epipolar``: how well the two-view geometry of each object explains the tracks of each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.trajectories import Tracks, look_up
from zsmoseg.grouping.epipolar import epipolar_residuals
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import Span, spans
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.statistics import shrink
from zsmoseg.workflows.stages.trajectories import read_tracks


def task(task: Task) -> Left:
    """Per shot and pair ``start``, ``gap``, ``offset`` into ``object`` and ``points``; ``residual`` px^2, row by row."""
    return Left(groups=_groups(task))


def _groups(task: Task) -> Iterator[tuple[str, Mapping[str, NDArray[Any]]]]:
    for span in spans(task.inputs["objects"]):
        tracks = read_tracks(task.inputs["trajectories"], span.name)
        on = _labels(task, span, tracks)
        found = list(epipolar_residuals(tracks, on, task.settings.trajectories.gaps))
        yield (
            span.name,
            {
                "start": np.array([pair.start for pair in found], np.int64),
                "gap": np.array([pair.gap for pair in found], np.int64),
                "offset": np.cumsum([0, *(len(pair.ids) for pair in found)], dtype=np.int64),
                "object": np.concatenate([np.zeros(0, np.int64), *(pair.ids for pair in found)]),
                "points": np.concatenate([np.zeros(0), *(pair.points for pair in found)]),
                "residual": np.concatenate([np.zeros(0), *(pair.residual.ravel() for pair in found)]),
            },
        )


def _labels(task: Task, span: Span, tracks: Tracks) -> NDArray[np.int64]:
    """(rows,) the object that each point is on, by its number within the shot."""
    found = []
    for t in range(span.stop - span.start):
        frame = span.start + t
        (label,) = shrink(task.inputs["labels"].read("label", frame, frame + 1), *task.grid)
        found.append(look_up(label, tracks.place[tracks.at(t)]))
    return np.searchsorted(span.objects, np.concatenate(found))


def each_pair(epipolar: Artifact, span: Span) -> Iterator[tuple[NDArray[np.int64], Any, Any]]:
    """Local ids, residuals and numbers of points of the pairs of a shot, in order."""
    table = epipolar.read_table(0, span.name)
    begin = 0
    for a, b in zip(table["offset"][:-1], table["offset"][1:], strict=True):
        count = int(b - a)
        residual = table["residual"][begin : begin + count**2].reshape(count, count)
        begin += count**2
        yield table["object"][a:b], residual, table["points"][a:b]


STAGE = Stage(
    "epipolar",
    1,
    task,
    inputs={"trajectories": ALL, "labels": ALL, "objects": ALL},
    sections=("frames", "trajectories"),
    scope="video",
    cost=(10.0, 4.0),
)
