"""Stage ``depth``: relative inverse depth of every frame; nothing where it is constant."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from zsmoseg.depth import inverse_depth
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video import Probe
from zsmoseg.workflows.stage import Left, Stage, Task, working_size


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``inverse_depth`` (frame, y, x), relative."""
    if settings.depth.source == "constant":
        return []
    shape = (len(probe.times), *working_size(probe, settings.frames.width))
    about = "relative inverse depth, near is large"
    return [ArraySpec("inverse_depth", ("frame", "y", "x"), shape, "float16", long_name=about)]


def task(task: Task) -> Left:
    """Depth of one chunk."""
    if task.settings.depth.source == "constant":
        return Left()
    frames = task.inputs["frames"].read("frame", task.start, task.stop)
    depth = [inverse_depth(frame, task.settings.depth) for frame in frames]
    return Left(arrays={"inverse_depth": np.stack([d for d in depth if d is not None]).astype(np.float16)})


STAGE = Stage("depth", 1, task, inputs={"frames": 0}, sections=("frames", "depth"), arrays=arrays)
