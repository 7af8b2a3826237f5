"""Stage ``segments``: superpixels of every frame."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from zsmoseg.proposals.embedded.superpixels import Superpixels, segment
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video import Probe
from zsmoseg.workflows.stage import Left, Stage, Task, working_size


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``segment`` (frame, y, x)."""
    shape = (len(probe.times), *working_size(probe, settings.frames.width))
    return [
        ArraySpec("segment", ("frame", "y", "x"), shape, "uint16", 0, long_name="superpixel", kind="label")
    ]


def task(task: Task) -> Left:
    """Superpixels of one chunk."""
    frames = task.inputs["frames"].read("frame", task.start, task.stop)
    superpixels = task.settings.segments.group(Superpixels)
    return Left(arrays={"segment": np.stack([segment(frame, superpixels) for frame in frames])})


STAGE = Stage(
    "segments",
    1,
    task,
    inputs={"frames": 0},
    sections=("frames", "segments"),
    arrays=arrays,
    cost=(7.0, 27.0),
)
