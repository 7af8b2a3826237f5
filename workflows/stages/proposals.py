"""Stage ``proposals``: imported masks as they are, frame by frame."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.imports import masks_of
from zsmoseg.workflows.stage import Left, Stage, Task


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``mask`` (frame, y, x), displayed size."""
    shape = (len(probe.times), probe.height, probe.width)
    about = "number of the imported mask, 0 = none"
    return [ArraySpec("mask", ("frame", "y", "x"), shape, "uint16", long_name=about, kind="label")]


def task(task: Task) -> Left:
    """The masks of one chunk; ``known`` (frame): whether there are any; the ``number`` of each, ``offset`` by frame."""
    found = list(masks_of(task.settings.proposals, task.probe, task.start, task.stop))
    empty = np.zeros((task.probe.height, task.probe.width), np.uint16)
    labels = np.stack([empty if f is None else f.label for f in found])
    numbers = [np.unique(label[label > 0]).astype(np.int64) for label in labels]
    return Left(
        arrays={"mask": labels},
        tables={
            "known": np.array([f is not None for f in found]),
            "offset": np.cumsum([0, *map(len, numbers)], dtype=np.int64),
            "number": np.concatenate([np.zeros(0, np.int64), *numbers]),
        },
        facts={"hidden": sum(0 if f is None else f.hidden for f in found)},
    )


STAGE = Stage(
    "proposals", 1, task, inputs={}, sections=("video", "proposals"), arrays=arrays, cost=(6.0, 8.0)
)
