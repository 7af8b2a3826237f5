"""Stage ``trajectories``: points followed along the flow, shot by shot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from numpy.typing import NDArray

from zsmoseg.flow.trajectories import Tracks, follow
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import shots
from zsmoseg.workflows.stage import ALL, Left, Stage, Task


def task(task: Task) -> Left:
    """Per shot ``track``, ``frame`` (from the start of the shot) and ``place`` (x, y) of every point at every frame."""
    return Left(groups=_groups(task))


def _groups(task: Task) -> Iterator[tuple[str, Mapping[str, NDArray[Any]]]]:
    flow = task.inputs["flow"]
    height, width = flow.shape("forward")[2:]
    for start, stop in shots(flow, task.frames):
        pairs = (
            (flow.read("forward", m, m + 1)[0], flow.read("backward", m, m + 1)[0])
            for m in range(start, stop - 1)
        )
        tracks = follow(pairs, height, width, task.settings.trajectories.spacing)
        yield f"{start:08d}-{stop:08d}", {"track": tracks.track, "frame": tracks.frame, "place": tracks.place}


def read_tracks(trajectories: Artifact, shot: str) -> Tracks:
    """The tracks of a shot."""
    return Tracks(**trajectories.read_table(0, shot))


STAGE = Stage(
    "trajectories", 1, task, inputs={"flow": ALL}, sections=("trajectories",), scope="video", cost=(2.0, 16.0)
)
