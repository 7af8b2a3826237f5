"""Stage ``objects`` of proposed masks: which object each mask of each frame belongs to, shot by shot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.fields import table
from zsmoseg.tracking.linking import Linker, Linking
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts
from zsmoseg.workflows.stages.front_end import Objects, shot_columns, shrink
from zsmoseg.workflows.stages.proposed.naming import categories
from zsmoseg.workflows.stages.proposed.proposals import Proposals, category_names

Ids = NDArray[np.int64]
HIGHEST = 1023
"""Ids up to here are kept as they are; sparser ones are numbered in their order, for tables grow with the highest."""


@dataclass(frozen=True)
class MaskObjects(Objects):
    """The objects as masks, those of all frames that have some one after the other."""

    known: NDArray[np.bool_] = table("frame", dtype="bool", meaning="whether there are masks of the frame")
    masks: Ids = table("frame", dtype="int64", meaning="how many masks it has")
    number: Ids = table("mask_of_frame", dtype="int64", meaning="number of the mask in its frame")
    object_of: Ids = table("mask_of_frame", dtype="int64", meaning="its object")
    origin: Ids = table("object", dtype="int64", meaning="its id in the files, 0 where they have none")
    category_of: Ids | None = table(
        "object", dtype="int64", meaning="its category, an index of the coordinate category; -1 = none"
    )
    score: NDArray[np.float32] | None = table(
        "object", dtype="float32", meaning="mean score of its masks of that category"
    )
    named: Ids | None = table("category", dtype="int64", meaning="objects of the category", add=True)


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    proposals: Proposals = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    proposals: settings.Proposals
    tags: settings.Tags
    linking: settings.Linking


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[MaskObjects]:
    """All shots of the video."""
    found = between_cuts(inputs.flow.state)
    known = _numbers(inputs.proposals)
    if s.proposals.source == "imported" and s.proposals.kind == "ids":
        objects, last, origin = _by_id(known, found)
    else:
        objects, last = _linked(inputs, s.linking, known, found, working_size(part.probe, s.frames.width))
        origin = np.zeros(last[-1] + 1, np.int64)
    object_of = np.concatenate([np.zeros(0, np.int64), *objects])
    yield MaskObjects(
        known=inputs.proposals.known,
        masks=inputs.proposals.masks,
        number=inputs.proposals.number,
        object_of=object_of,
        origin=origin,
        **named_objects(inputs.proposals, object_of, len(origin), len(categories(s.proposals, s.tags))),
        **shot_columns(part.frames, found, last),
    )


def named_objects(proposals: Proposals, object_of: Ids, objects: int, names: int) -> dict[str, Any]:
    """The fields of ``MaskObjects`` about categories: each object has the one whose masks have most score in all.

    Parameters
    ----------
    object_of
        Of every mask, in the order of ``proposals.number``; 0 = none.
    objects
        Number of objects, the background among them.
    names
        Number of categories; without any there are no such fields.
    """
    if not names:
        return {}
    assert proposals.category_of is not None
    assert proposals.score is not None
    # only the pairs of object and category that masks have: a table of all grows with the square of a video's length
    cell, row, masks = np.unique(
        object_of * names + proposals.category_of, return_inverse=True, return_counts=True
    )
    votes = np.bincount(row.ravel(), proposals.score.astype(np.float64), len(cell))
    order = np.lexsort((-cell, votes))  # of those that are assigned to one place the last one stays
    top = np.full(objects, -1, np.int64)
    top[cell[order] // names] = order
    top[0] = -1
    some = (top >= 0) & (np.append(votes, 0.0)[top] > 0)
    best = np.append(cell % names, 0)[top]
    score = np.where(some, np.append(votes / masks, np.nan)[top], np.nan)
    return {
        "category_of": np.where(some, best, -1).astype(np.int64),
        "score": score.astype(np.float32),
        "named": np.bincount(best[some], minlength=names).astype(np.int64),
    }


def object_names(artifact: Artifact) -> list[str]:
    """What networks call each object of a video; no list where nothing is named."""
    names, of = category_names(artifact), MaskObjects.read(artifact).category_of
    return [] if of is None else [names[n] if n >= 0 else "" for n in of]


def labels_of_categories(s: Any) -> Mapping[str, Sequence[str]]:
    """The coordinate ``category``, where networks name what they see."""
    names = categories(s.proposals, s.tags)
    return {"category": names} if names else {}


def _numbers(proposals: Proposals) -> dict[int, Ids]:
    """Every frame with masks, and their numbers."""
    ends = np.cumsum([0, *proposals.masks])
    return {int(t): proposals.number[ends[t] : ends[t + 1]] for t in np.flatnonzero(proposals.known)}


def _by_id(known: dict[int, Ids], found: list[tuple[int, int]]) -> tuple[list[Ids], list[int], Ids]:
    """Object = id in the first shot; later shots go on counting, for objects live within a shot."""
    ids = np.unique(np.concatenate([np.zeros(0, np.int64), *known.values()]))
    if ids.size and ids[-1] <= HIGHEST:
        ids = np.arange(1, ids[-1] + 1)
    count = len(ids)
    starts = np.array([start for start, _ in found])
    objects = []
    for frame, numbers in known.items():
        shot = int(np.searchsorted(starts, frame, side="right")) - 1
        objects.append(np.searchsorted(ids, numbers) + 1 + shot * count)
    last = [count * (shot + 1) for shot in range(len(found))]
    return objects, last, np.append(0, np.tile(ids, len(found))).astype(np.int64)


def _linked(
    inputs: Inputs,
    s: settings.Linking,
    known: dict[int, Ids],
    found: list[tuple[int, int]],
    grid: tuple[int, int],
) -> tuple[list[Ids], list[int]]:
    """Masks of single frames, linked along the flow on the working grid; frame by frame."""
    linker, objects, last = Linker(s.parameters(Linking)), [], []
    for start, stop in found:
        linker.start(grid)
        for t in range(start, stop):
            if t > start:
                linker.carry(inputs.flow.of(t - 1, t).backward[0])
            if t in known:
                (small,) = shrink(inputs.proposals.of(t, t + 1).mask, *grid)
                objects.append(linker.see(small, known[t]))
        last.append(linker.last)
    return objects, last


def lookups(objects: MaskObjects, frames: Iterable[int]) -> dict[int, Ids]:
    """For some frames with masks the table from number to object."""
    ends, found = np.append(0, np.cumsum(objects.masks)), {}
    for t in frames:
        rows = slice(ends[t], ends[t + 1])
        lookup = np.zeros(int(objects.number[rows].max(initial=0)) + 1, np.int64)
        lookup[objects.number[rows]] = objects.object_of[rows]
        found[t] = lookup
    return found


STAGE = Stage(
    "objects",
    3,
    task,
    Inputs,
    Sections,
    MaskObjects,
    "video",
    labels=labels_of_categories,
    cost=(2.0, 0.1),
    memory=Memory(shown=10, frames=lambda s: 1),
)
