"""Stage ``objects``: which superpixels are foreground and which object each belongs to, shot by shot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.objects import find_objects, parameters
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import overlapping, shots
from zsmoseg.workflows.stage import ALL, Left, Stage, Task

BLOCK = 16
"""Frames of one group of tables."""


def loader(tables: Artifact) -> Callable[[int, int], SuperpixelFeatures]:
    """``load(a, b)``: the features of frames a to b - 1, from the chunks they lie in."""

    def load(start: int, stop: int) -> SuperpixelFeatures:
        found = list(overlapping(tables, start, stop))
        chunks = [SuperpixelFeatures(**tables.read_table(i)) for i, _, _ in found]
        first = found[0][1]
        return SuperpixelFeatures.join(chunks).part(start - first, stop - first)

    return load


def task(task: Task) -> Left:
    """All shots of the video, one after the other; ids go on counting from shot to shot."""
    summary: dict[str, NDArray[Any]] = {}
    return Left(tables=summary, groups=_blocks(task, summary))


def _blocks(task: Task, summary: dict[str, NDArray[Any]]) -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
    """The superpixels of ``BLOCK`` frames at a time; ``summary`` is filled on the way."""
    found = shots(task.inputs["flow"], task.frames)
    load, scores, last = loader(task.inputs["tables"]), [], [0]
    values: list[NDArray[np.float32]] = []
    ids: list[NDArray[np.int32]] = []
    frame, settings = 0, parameters(task.settings.objects.group)
    for shot in found:
        highest = last[-1]
        for value, named, score in find_objects(load, shot, task.grid, settings):
            values.append(value)
            ids.append(np.where(named > 0, named + last[-1], 0).astype(np.int32))
            highest = max(highest, int(ids[-1].max(initial=0)))
            scores.append(score)
            frame += 1
            if frame % BLOCK == 0 or frame == task.frames:
                offset = np.cumsum([0, *map(len, values)], dtype=np.int64)
                block: dict[str, NDArray[Any]] = {"offset": offset, "value": np.concatenate(values)}
                block["object"] = np.concatenate(ids)
                yield f"{frame - len(values):08d}", block
                values, ids = [], []
        last.append(highest)
    summary["score"] = np.array(scores, np.float32)
    summary["shot"] = np.array(found, np.int64)
    summary["last"] = np.array(last[1:], np.int64)


def read_frame_objects(objects: Artifact, frame: int) -> NDArray[np.int32]:
    """Object of the superpixels of one frame."""
    table = objects.read_table(0, f"{frame // BLOCK * BLOCK:08d}")
    a, b = table["offset"][frame % BLOCK : frame % BLOCK + 2]
    return table["object"][a:b]


STAGE = Stage(
    "objects",
    2,
    task,
    inputs={"tables": ALL, "flow": ALL},
    sections=("frames", "objects"),
    scope="video",
    cost=(14.2, 6.2),
)
