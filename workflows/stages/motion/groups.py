"""Stage ``groups``: what moves, with what, and when: shot by shot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.evidence import PairGrams
from zsmoseg.grouping.groups import Grouping, ShotGroups, group_shot
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, local_ids, shots_of
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.statistics import Statistics

Floats = NDArray[np.float64]
Ids = NDArray[np.int64]
UNCHANGED = 1e-9
"""Change of the image (grey levels^2 px) that counts as none: a divisor above 0."""


@dataclass(frozen=True)
class Groups(Arrays):
    """The answer, and the evidence for it; a block is a shot."""

    object: Ids = table("object", dtype="int64", meaning="object")
    group: Ids = table("object", dtype="int64", meaning="motion group, 0 = static")
    instance: Ids = table("object", dtype="int64", meaning="instance that the object belongs to, 0 = static")
    frames: Ids = table(
        "object", dtype="int64", meaning="frames in which it is seen", unit="frames", add=True
    )
    area: Ids = table(
        "object", dtype="int64", meaning="pixels as displayed, all frames", unit="px^2", add=True
    )
    score: Floats = table("object", dtype="float64", meaning="mean excess over the static world", unit="px")
    threshold: Floats = table("object", dtype="float64", meaning="score from which it moves", unit="px")
    visibility: Floats = table(
        "object",
        dtype="float64",
        meaning="what the world's motion leaves of its image, over what its flow leaves",
    )
    moving: NDArray[np.bool_] = table(
        "frame", "object", dtype="bool", meaning="whether it moves at the frame"
    )
    margin: NDArray[np.float32] = table("frame", "object", dtype="float32", meaning="ln(excess / threshold)")
    shot: Ids = table("shot", dtype="int64", meaning="shot")
    yardstick: Floats = table(
        "shot", dtype="float64", meaning="what most of the background stays below", unit="px"
    )
    largest_cell: Floats = table(
        "shot", dtype="float64", meaning="largest excess of the background", unit="px"
    )
    cell_excess: Floats = table(
        "shot", "cell", dtype="float64", meaning="excess of cells of the background", unit="px"
    )
    eigenvalue: Floats = table(
        "shot", "rank", dtype="float64", meaning="of the normalised affinity, the largest first"
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    affinity: Affinity = reach(ALL)
    statistics: Statistics = reach(ALL)
    labels: Labels = reach(ALL)
    objects: Objects = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    motion: settings.Motion
    groups: settings.Groups


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Groups]:
    """One shot after the other; groups and instances go on counting from shot to shot."""
    warnings: list[str] = []
    part.facts["warnings"] = warnings
    found = shots_of(inputs.objects)
    groups = instances = 0
    for shot in found:
        visibility = read_visibility(inputs.statistics, shot)
        answer = _group(part, inputs, shot, visibility, s)
        where = "" if len(found) == 1 else f"frames {shot.start} to {shot.stop - 1}: "
        warnings += [f"{where}{text}" for text in answer.warnings]
        yield _left(inputs.labels, shot, answer, visibility, (groups, instances))
        groups, instances = groups + int(answer.group.max()), instances + int(answer.instance.max())


def _group(part: Part, inputs: Inputs, shot: Shot, visibility: Floats, s: Sections) -> ShotGroups:
    def pairs() -> Iterator[PairGrams]:
        return each_pair(inputs.statistics, shot)

    (affinity,) = inputs.affinity.of(shot.start, shot.stop).blocks()
    grid = working_size(part.probe, s.frames.width)
    pieces = read_pieces(inputs.statistics, shot)
    return group_shot(
        pairs, pieces, affinity.affinity, grid, s.motion.model, s.groups.parameters(Grouping), visibility
    )


def _left(
    labels: Labels, shot: Shot, answer: ShotGroups, visibility: Floats, before: tuple[int, int]
) -> Groups:
    """What is kept of a shot; ``before`` are the largest group and instance of the shots before it."""
    d = answer.decision
    unreached = max(d.largest, float(d.score.max(initial=0.0)))
    frames, area = _displayed(labels, shot)
    return Groups(
        start=shot.start,
        stop=shot.stop,
        object=shot.objects,
        group=np.where(answer.group > 0, answer.group + before[0], 0),
        instance=np.where(answer.instance > 0, answer.instance + before[1], 0),
        frames=frames,
        area=area,
        score=d.score,
        threshold=np.where(np.isfinite(d.threshold), d.threshold, unreached),
        visibility=visibility,
        moving=answer.moving,
        margin=answer.margin,
        shot=np.array([shot.number], np.int64),
        yardstick=np.array([d.yardstick]),
        largest_cell=np.array([d.largest]),
        cell_excess=np.asarray(d.evidence.cells)[None],
        eigenvalue=answer.eigenvalues[None],
    )


def _displayed(labels: Labels, shot: Shot) -> tuple[Ids, Ids]:
    """(objects of the shot,) frames in which each is seen, and its pixels at the displayed size."""
    frames, area = np.zeros((2, len(shot.objects)), np.int64)
    for block in labels.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        rows = slice(max(shot.start - block.start, 0), shot.stop - block.start)
        seen = block.area[rows][:, keep]
        frames[ids] += (seen > 0).sum(0)
        area[ids] += seen.sum(0)
    return frames, area


def each_pair(statistics: Statistics, shot: Shot) -> Iterator[PairGrams]:
    """The valid pairs of a shot, numbered from its start, with local ids."""
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for k in np.flatnonzero(block.valid):
            if shot.start <= block.start + k < shot.stop - 1:
                pair = int(block.start + k) - shot.start
                yield PairGrams(pair, ids, block.gram[k][keep], block.cells[k])


def read_visibility(statistics: Statistics, shot: Shot) -> Floats:
    """(objects of the shot,) what the world's motion leaves unexplained over what the flow does."""
    total = np.zeros((len(shot.objects), 2))
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for k, values in enumerate(block.unexplained):
            if shot.start <= block.start + k < shot.stop - 1:
                total[ids] += values[keep]
    return np.asarray(total[:, 0] / np.maximum(total[:, 1], UNCHANGED))


def read_pieces(statistics: Statistics, shot: Shot) -> Pieces:
    """Place and colour of the objects of a shot."""
    frames, count = shot.stop - shot.start, len(shot.objects)
    area = np.zeros((frames, count), np.int32)
    box = np.full((frames, count, 4), np.nan, np.float32)
    colour: Ids | None = None
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        first, last = max(block.start, shot.start), min(block.stop, shot.stop)
        rows = slice(first - block.start, last - block.start)
        area[first - shot.start : last - shot.start, ids] = block.area[rows][:, keep]
        box[first - shot.start : last - shot.start, ids] = block.box[rows][:, keep]
        if colour is None:
            colour = np.zeros((count, block.colour.shape[1]), np.int64)
        colour[ids] += block.colour[keep]
    assert colour is not None
    return Pieces(area, box, colour)


def moving_objects(groups: Groups, start: int, stop: int) -> NDArray[np.bool_]:
    """(frames, all objects) whether each object moves at each of the frames ``start`` to ``stop - 1``."""
    out = np.zeros((stop - start, len(groups.group)), np.bool_)
    part = groups.of(start, stop)
    out[:, part.object] = part.moving
    return out


STAGE = Stage("groups", 4, task, Inputs, Sections, Groups, "video", cost=(1.1, 0.1))
