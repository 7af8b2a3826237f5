"""Stage ``statistics``: the one pass over the pixels behind every motion model, and place and colour of the objects."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.linking import measure_pieces
from zsmoseg.motion.models import SIZE
from zsmoseg.motion.photometric import explained, grey, world_motion
from zsmoseg.motion.statistics import UNUSED, pair_statistics, slots
from zsmoseg.workflows.reading import read_states
from zsmoseg.workflows.stage import Left, Stage, Task


def task(task: Task) -> Left:
    """``gram`` (pair, slot, 11, 11), ``cells`` (pair, cell, 11, 11), ``unexplained`` (pair, slot, world or flow), pieces."""
    labels = shrink(task.inputs["labels"].read("label", task.start, task.stop), *task.grid)
    frames = task.inputs["frames"].read("frame", task.start, min(task.stop + 1, task.frames))
    ignore = task.ignored
    pixels = np.bincount(labels.ravel())
    ids = np.union1d([0], np.flatnonzero(pixels)).astype(np.int64)
    s = task.settings.statistics
    rows = len(ids) + s.cells_y * s.cells_x
    grams = np.zeros((task.last_pair - task.start, rows, SIZE, SIZE))
    valid = read_states(task.inputs["flow"], task.start, task.last_pair) == 0
    flow, back = (task.inputs["flow"].read(n, task.start, task.last_pair) for n in ("forward", "backward"))
    depth = task.inputs["depth"]
    known = depth.read("inverse_depth", task.start, task.stop) if depth.has("inverse_depth") else None
    unexplained = np.zeros((len(grams), len(ids), 2))
    looks = [grey(frame) for frame in frames]
    for m in np.flatnonzero(valid):
        inverse_depth = None if known is None else known[m]
        grams[m] = pair_statistics(labels[m], ids, flow[m], back[m], inverse_depth, ignore, s)
        world = world_motion(grams[m, 0], grams[m, : len(ids)].sum(0))
        slot = slots(labels[m], ids)
        if ignore is not None:
            slot[ignore] = UNUSED
        unexplained[m] = explained(looks[m], looks[m + 1], flow[m], world, slot, len(ids))
    pieces = measure_pieces(labels, frames[: task.stop - task.start], ids)
    return Left(
        tables={
            "object": ids,
            "valid": valid,
            "gram": grams[:, : len(ids)],
            "cells": grams[:, len(ids) :],
            "unexplained": unexplained,
            "area": pieces.area,
            "box": pieces.box,
            "colour": pieces.colour,
        }
    )


def shrink(labels: NDArray[np.uint16], height: int, width: int) -> NDArray[np.uint16]:
    """Labels on the working grid: nearest."""
    size = width, height
    return np.stack([cv2.resize(label, size, interpolation=cv2.INTER_NEAREST_EXACT) for label in labels])


STAGE = Stage(
    "statistics",
    4,
    task,
    inputs={"frames": 1, "flow": 0, "depth": 0, "labels": 0},
    sections=("frames", "statistics", "ignore"),
    cost=(3.9, 18.0),
)
