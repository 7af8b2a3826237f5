"""Stage ``depth``: relative inverse depth of every frame; nothing where it is constant."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from zsmoseg.depth.ground import ground
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.imports import depth_of
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
    if task.settings.depth.source == "imported":
        depth = list(depth_of(task.settings.depth, task.probe, task.start, task.stop, task.grid))
    else:
        depth = [ground(*task.grid)] * (task.stop - task.start)
    return Left(arrays={"inverse_depth": np.stack(depth).astype(np.float16)})


STAGE = Stage("depth", 1, task, inputs={"frames": 0}, sections=("frames", "depth"), arrays=arrays)
