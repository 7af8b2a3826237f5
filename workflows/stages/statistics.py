"""Stage ``statistics``: the one pass over the pixels behind every motion model, and place and colour of the objects."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.pieces import measure_pieces
from zsmoseg.motion.measuring import measure_pair
from zsmoseg.motion.models import SIZE
from zsmoseg.motion.photometric import grey
from zsmoseg.motion.statistics import Sums
from zsmoseg.workflows.reading import read_states
from zsmoseg.workflows.stage import Left, Stage, Task


def task(task: Task) -> Left:
    """``gram`` (pair, slot, 11, 11), ``cells`` (pair, cell, 11, 11), ``unexplained`` (pair, slot, world or flow), pieces."""
    labels = shrink(task.inputs["labels"].read("label", task.start, task.stop), *task.grid)
    frames = task.inputs["frames"].read("frame", task.start, min(task.stop + 1, task.frames))
    ignore = task.ignored
    pixels = np.bincount(labels.ravel())
    ids = np.union1d([0], np.flatnonzero(pixels)).astype(np.int64)
    sums, pairs = task.settings.statistics.group(Sums), task.last_pair - task.start
    grams = np.zeros((pairs, len(ids), SIZE, SIZE))
    cells = np.zeros((pairs, sums.cells_y * sums.cells_x, SIZE, SIZE))
    valid = read_states(task.inputs["flow"], task.start, task.last_pair) == 0
    forward, backward = (
        task.inputs["flow"].read(n, task.start, task.last_pair) for n in ("forward", "backward")
    )
    depths = task.inputs["depth"]
    known = depths.read("inverse_depth", task.start, task.stop) if depths.has("inverse_depth") else None
    unexplained = np.zeros((pairs, len(ids), 2))
    looks = [grey(frame) for frame in frames]
    for m in np.flatnonzero(valid):
        depth = None if known is None else known[m]
        found = measure_pair(
            labels[m], ids, forward[m], backward[m], depth, (looks[m], looks[m + 1]), ignore, sums
        )
        grams[m], cells[m], unexplained[m] = found.gram, found.cells, found.unexplained
    pieces = measure_pieces(labels, frames[: task.stop - task.start], ids)
    return Left(
        tables={
            "object": ids,
            "valid": valid,
            "gram": grams,
            "cells": cells,
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
