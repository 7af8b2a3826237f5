"""Stage ``labels`` of imported masks: lookups; between frames with masks those are carried along the flow."""

from __future__ import annotations

import numpy as np

from zsmoseg.proposals.given.propagate import Flow, here, look_up, nearest_known, step
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import shots
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.imported_objects import read_lookups
from zsmoseg.workflows.stages.labels import arrays, measured


def task(task: Task) -> Left:
    """Paint one chunk; ``object`` and ``area`` (frame, object) say what is in it."""
    lookups = read_lookups(task.inputs["objects"])
    known = np.isin(np.arange(task.frames), list(lookups))
    ignored = task.ignored_at(task.probe.height, task.probe.width)
    labels = np.zeros((task.stop - task.start, task.probe.height, task.probe.width), np.uint16)
    for start, stop in shots(task.inputs["flow"], task.frames):
        nearest = nearest_known(known, start, stop)
        for t in range(max(start, task.start), min(stop, task.stop)):
            if (source := int(nearest[t - start])) >= 0:
                mask = task.inputs["proposals"].read("mask", source, source + 1)[0]
                label = lookups[source][mask].astype(np.uint16)
                labels[t - task.start] = (
                    label if source == t else look_up(label, _path(task.inputs["flow"], source, t))
                )
    if ignored is not None:
        labels[:, ignored] = 0
    return Left(arrays={"label": labels}, tables=measured(labels))


def _path(flow: Artifact, source: int, frame: int) -> Flow:
    """Where the pixels of ``frame`` lie in the frame ``source``, on the working grid."""
    where: Flow = here(*flow.shape("forward")[2:])
    if source < frame:
        for pair in range(source, frame):
            where = step(where, flow.read("backward", pair, pair + 1)[0])
    else:
        for pair in reversed(range(frame, source)):
            where = step(where, flow.read("forward", pair, pair + 1)[0])
    return where


STAGE = Stage(
    "labels",
    1,
    task,
    inputs={"proposals": ALL, "objects": ALL, "flow": ALL},
    sections=("ignore",),
    arrays=arrays,
    cost=(3.0, 5.0),
)
