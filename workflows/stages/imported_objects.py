"""Stage ``objects`` of imported masks: which object each mask of each frame belongs to, shot by shot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.proposals.given.link import Linker, Linking
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import shots
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.statistics import shrink

Ids = NDArray[np.int64]
HIGHEST = 1023
"""Ids up to here are kept as they are; sparser ones are numbered in their order, for tables grow with the highest."""


def task(task: Task) -> Left:
    """``shot``, ``last`` as the embedded objects; ``frame``, ``offset``, ``number``, ``object``: of the masks; ``origin``."""
    found = shots(task.inputs["flow"], task.frames)
    known = list(_numbers(task.inputs["proposals"]))
    if task.settings.proposals.kind == "ids":
        objects, last, origin = _by_id(known, found)
    else:
        objects, last = _linked(task, known, found)
        origin = np.zeros(last[-1] + 1, np.int64)
    return Left(
        tables={
            "shot": np.array(found, np.int64),
            "last": np.array(last, np.int64),
            "frame": np.array([frame for frame, _ in known], np.int64),
            "offset": np.cumsum([0, *(len(numbers) for _, numbers in known)], dtype=np.int64),
            "number": np.concatenate([np.zeros(0, np.int64), *(numbers for _, numbers in known)]),
            "object": np.concatenate([np.zeros(0, np.int64), *objects]),
            "origin": origin,
        }
    )


def _numbers(proposals: Artifact) -> Iterator[tuple[int, Ids]]:
    """Every frame with masks, and their numbers."""
    for part, (start, _) in enumerate(proposals.parts):
        table = proposals.read_table(part)
        for t in np.flatnonzero(table["known"]):
            yield start + int(t), table["number"][table["offset"][t] : table["offset"][t + 1]]


def _by_id(known: list[tuple[int, Ids]], found: list[tuple[int, int]]) -> tuple[list[Ids], list[int], Ids]:
    """Object = id in the first shot; later shots go on counting, for objects live within a shot."""
    ids = np.unique(np.concatenate([np.zeros(0, np.int64), *(numbers for _, numbers in known)]))
    if ids.size and ids[-1] <= HIGHEST:
        ids = np.arange(1, ids[-1] + 1)
    count = len(ids)
    starts = np.array([start for start, _ in found])
    shot_of = [int(np.searchsorted(starts, frame, side="right")) - 1 for frame, _ in known]
    objects = [
        np.searchsorted(ids, numbers) + 1 + shot * count
        for shot, (_, numbers) in zip(shot_of, known, strict=True)
    ]
    last = [count * (shot + 1) for shot in range(len(found))]
    return objects, last, np.append(0, np.tile(ids, len(found))).astype(np.int64)


def _linked(
    task: Task, known: list[tuple[int, Ids]], found: list[tuple[int, int]]
) -> tuple[list[Ids], list[int]]:
    """Masks of single frames, linked along the flow on the working grid; frame by frame."""
    s, flow, proposals = task.settings.proposals, task.inputs["flow"], task.inputs["proposals"]
    height, width = flow.shape("backward")[2:]
    linker, objects, last, of_frame = Linker(s.group(Linking)), [], [], dict(known)
    for start, stop in found:
        linker.start((height, width))
        for t in range(start, stop):
            if t > start:
                linker.carry(flow.read("backward", t - 1, t)[0])
            if t in of_frame:
                (small,) = shrink(proposals.read("mask", t, t + 1), height, width)
                objects.append(linker.see(small, of_frame[t]))
        last.append(linker.last)
    return objects, last


def read_lookups(objects: Artifact) -> dict[int, Ids]:
    """For every frame with masks the table from number to object."""
    table = objects.read_table(0)
    found = {}
    for k, frame in enumerate(table["frame"]):
        rows = slice(table["offset"][k], table["offset"][k + 1])
        lookup = np.zeros(int(table["number"][rows].max(initial=0)) + 1, np.int64)
        lookup[table["number"][rows]] = table["object"][rows]
        found[int(frame)] = lookup
    return found


STAGE = Stage(
    "objects",
    1,
    task,
    inputs={"proposals": ALL, "flow": ALL},
    sections=("proposals",),
    scope="video",
    cost=(2.0, 0.1),
)
