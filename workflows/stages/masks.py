"""Stage ``masks``: the images in the output folder: groups in ``masks``, things in ``objects``."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from zsmoseg.masks import encode_png, paint_table
from zsmoseg.stores.artifact import Artifact
from zsmoseg.video import Probe
from zsmoseg.workflows.stage import ALL, Left, Stage, Task


def files(probe: Probe, start: int, stop: int, settings: SimpleNamespace) -> list[str]:
    """The images of frames ``start`` to ``stop``, named like the frames."""
    return [f"{folder}/{name}.png" for name in probe.names[start:stop] for folder in ("masks", "objects")]


def moving_objects(groups: Artifact, start: int, stop: int, count: int) -> NDArray[np.bool_]:
    """(frames, objects) whether each object moves at each of the frames, from the shots they lie in."""
    out = np.zeros((stop - start, count), np.bool_)
    for shot in groups.groups(0):
        a, b = map(int, shot.split("-")[1:])
        first, last = max(a, start), min(b, stop)
        if first < last:
            state = groups.read_table(0, shot)
            out[first - start : last - start, state["object"]] = state["moving"][first - a : last - a]
    return out


def task(task: Task) -> Left:
    """Paint one chunk."""
    labels = task.inputs["labels"].read("label", task.start, task.stop)
    table = task.inputs["groups"].read_table(0)
    when = task.settings.masks.when
    moving = moving_objects(task.inputs["groups"], task.start, task.stop, len(table["group"]))
    sizes = {}
    names = iter(files(task.probe, task.start, task.stop, task.settings))
    for label, state in zip(labels, moving, strict=True):
        groups, things = (paint_table(table[column], state, when) for column in ("group", "instance"))
        image = encode_png(groups[label])
        other = image if np.array_equal(groups, things) else encode_png(things[label])
        for data, name in zip((image, other), names, strict=False):
            sizes[name] = write_bytes(Path(task.out) / name, data)
    return Left(facts={"files": sizes})


def write_bytes(path: Path, data: bytes) -> int:
    """Write a file whole or not at all; its size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    partial.write_bytes(data)
    partial.replace(path)
    return len(data)


STAGE = Stage(
    "masks", 1, task, inputs={"labels": 0, "groups": ALL}, sections=("masks",), files=files, cost=(2.7, 4.0)
)
