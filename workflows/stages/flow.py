"""Stage ``flow``: optical flow of every pair in both directions, and which pairs are cuts or repeats."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from zsmoseg import flow
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video import Probe
from zsmoseg.workflows.imports import flow_of
from zsmoseg.workflows.stage import Left, Stage, Task, working_size


def arrays(probe: Probe, settings: SimpleNamespace) -> list[ArraySpec]:
    """``forward``, ``backward`` (pair, component, y, x) in px of the working grid; ``state``, ``valid`` (pair)."""
    pairs = len(probe.times) - 1
    grid = working_size(probe, settings.frames.width)
    return [
        ArraySpec(
            name,
            ("pair", "component", "y", "x"),
            (pairs, 2, *grid),
            "int16",
            -32768,
            scale=1 / 64,
            units="px",
            long_name=f"{name} optical flow, x then y",
        )
        for name in ("forward", "backward")
    ]


def task(task: Task) -> Left:
    """Flow of the pairs that start in one chunk."""
    frames = task.inputs["frames"].read("frame", task.start, task.last_pair + 1)
    forward, backward, states = [], [], []
    for (a, b), (there, back) in zip(pairwise(frames), _pairs(task, frames), strict=True):
        forward.append(there)
        backward.append(back)
        states.append(flow.STATES.index(flow.pair_state(a, b, there, back, task.settings.flow)))
    grid = task.grid
    state = np.array(states, np.uint8)
    return Left(
        arrays={
            "forward": np.stack(forward) if forward else np.zeros((0, 2, *grid), np.float32),
            "backward": np.stack(backward) if backward else np.zeros((0, 2, *grid), np.float32),
        },
        tables={"state": state, "valid": state == 0},
    )


def _pairs(
    task: Task, frames: NDArray[np.uint8]
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Flow there and back of every pair of the chunk."""
    s = task.settings.flow
    if s.source == "imported":
        return flow_of(s, task.probe, task.start, task.last_pair, task.grid)
    return (flow.between(a, b, s) for a, b in pairwise(frames))


STAGE = Stage(
    "flow", 1, task, inputs={"frames": 1}, sections=("frames", "flow"), arrays=arrays, cost=(23.9, 328.4)
)
