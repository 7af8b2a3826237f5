"""Stage ``frames``: the source decoded once, at the working size."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np

from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video.frames import read
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.stage import Left, Stage, Task, working_size


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``frame`` (frame, y, x, channel), BGR as OpenCV has it."""
    height, width = working_size(probe, settings.frames.width)
    return [
        ArraySpec(
            "frame",
            ("frame", "y", "x", "channel"),
            (len(probe.times), height, width, 3),
            "uint8",
            0,
            long_name="frame at the working size, blue green red",
        )
    ]


def task(task: Task) -> Left:
    """Decode and resize the frames of one chunk."""
    height, width = task.grid
    images = read(task.probe, task.start, task.stop)
    return Left(
        arrays={
            "frame": np.stack([cv2.resize(i, (width, height), interpolation=cv2.INTER_AREA) for i in images])
        }
    )


STAGE = Stage("frames", 1, task, inputs={}, sections=("video", "frames"), arrays=arrays, cost=(1.7, 302.7))
