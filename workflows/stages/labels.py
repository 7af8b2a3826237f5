"""Stage ``labels``: the object of every pixel, at the displayed size."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from zsmoseg.proposals.embedded.guided_filter import GuidedFilter
from zsmoseg.proposals.embedded.pixels import paint
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video import Probe
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.objects import read_frame_objects


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``label`` (frame, y, x), displayed size."""
    shape = (len(probe.times), probe.height, probe.width)
    return [
        ArraySpec("label", ("frame", "y", "x"), shape, "uint16", long_name="object, 0 = none", kind="label")
    ]


def task(task: Task) -> Left:
    """Paint one chunk; ``object`` and ``area`` (frame, object) say what is in it."""
    frames = task.inputs["frames"].read("frame", task.start, task.stop)
    segments = task.inputs["segments"].read("segment", task.start, task.stop)
    shape = task.probe.height, task.probe.width
    ignored = task.ignored_at(*shape)
    labels = np.zeros((len(frames), *shape), np.uint16)
    for label, frame, segment, t in zip(labels, frames, segments, range(task.start, task.stop), strict=True):
        ids = read_frame_objects(task.inputs["objects"], t)
        label[:] = paint(frame, segment, ids, shape, task.settings.labels.group(GuidedFilter))
        if ignored is not None:
            label[ignored] = 0
    return Left(arrays={"label": labels}, tables=measured(labels))


def measured(labels: NDArray[np.uint16]) -> dict[str, NDArray[np.int64]]:
    """The objects in ``labels`` (frames, H, W), and ``area`` (frames, objects) in px."""
    largest = int(labels.max())
    area = np.stack([np.bincount(label.ravel(), minlength=largest + 1) for label in labels])
    present = np.flatnonzero(area.any(0))
    return {"object": present.astype(np.int64), "area": area[:, present].astype(np.int64)}


STAGE = Stage(
    "labels",
    1,
    task,
    inputs={"frames": 0, "segments": 0, "objects": ALL},
    sections=("labels", "ignore"),
    arrays=arrays,
    cost=(4.2, 1.3),
)
