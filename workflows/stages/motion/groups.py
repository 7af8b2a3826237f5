"""Stage ``groups``: what moves, with what, and when: shot by shot.

It reads the affinity and what lies beside it, and of the statistics the places of the objects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.affinity import ShotAffinity
from zsmoseg.grouping.groups import Grouping, ShotGroups, group_shot
from zsmoseg.grouping.instances import end_velocities
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.motion.models import Floats
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, local_ids, shots_of
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.statistics import Statistics

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Groups(Arrays):
    """The answer; a block is a shot."""

    object: Ids = table("object", dtype="int64", meaning="object")
    group: Ids = table("object", dtype="int64", meaning="motion group, 0 = static")
    instance: Ids = table("object", dtype="int64", meaning="instance that the object belongs to, 0 = static")
    frames: Ids = table(
        "object", dtype="int64", meaning="frames in which it is seen", unit="frames", add=True
    )
    area: Ids = table(
        "object", dtype="int64", meaning="pixels as displayed, all frames", unit="px^2", add=True
    )
    excess: Floats = table(
        "object",
        dtype="float64",
        meaning="what one motion for it and the static world costs, mean over the pairs",
        unit="px",
    )
    tolerance: Floats = table("object", dtype="float64", meaning="what of that is tolerated", unit="px")
    moving: NDArray[np.bool_] = table(
        "frame", "object", dtype="bool", meaning="whether it moves at the frame"
    )
    margin: NDArray[np.float32] = table(
        "frame",
        "object",
        dtype="float32",
        meaning="ln of the odds against the static world: what it costs it, over what is tolerated",
    )
    shot: Ids = table("shot", dtype="int64", meaning="shot")

    @property
    def world(self) -> Floats:
        """(object,) affinity with the static world: one half = at the tolerance; NaN = unknown."""
        return self.tolerance / (self.tolerance + self.excess)

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
    groups: settings.Groups


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Groups]:
    """One shot after the other; groups and instances go on counting from shot to shot."""
    warnings: list[str] = []
    part.facts["warnings"] = warnings
    shots, grid = shots_of(inputs.objects), working_size(part.probe, s.frames.width)
    grouping, groups, instances = s.groups.parameters(Grouping), 0, 0
    for shot in shots:
        pieces, velocity = read_pieces(inputs.statistics, shot)
        answer = group_shot(read_affinity(inputs.affinity, shot), pieces, velocity, grid, grouping)
        where = "" if len(shots) == 1 else f"frames {shot.start} to {shot.stop - 1}: "
        warnings += [f"{where}{text}" for text in answer.warnings]
        yield _left(inputs.labels, shot, answer, (groups, instances))
        groups, instances = groups + int(answer.group.max()), instances + int(answer.instance.max())


def _left(labels: Labels, shot: Shot, answer: ShotGroups, before: tuple[int, int]) -> Groups:
    """What is kept of a shot; ``before`` are the largest group and instance of the shots before it."""
    frames, area = _displayed(labels, shot)
    return Groups(
        start=shot.start,
        stop=shot.stop,
        object=shot.objects,
        group=np.where(answer.group > 0, answer.group + before[0], 0),
        instance=np.where(answer.instance > 0, answer.instance + before[1], 0),
        frames=frames,
        area=area,
        excess=answer.excess,
        tolerance=answer.tolerance,
        moving=answer.moving,
        margin=answer.margin,
        shot=np.array([shot.number], np.int64),
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


def read_affinity(affinity: Affinity, shot: Shot) -> ShotAffinity:
    """The affinity of a shot and what lies beside it."""
    (block,) = affinity.of(shot.start, shot.stop).blocks()
    return ShotAffinity(**{f.name: getattr(block, f.name) for f in fields(ShotAffinity)})


def read_pieces(statistics: Statistics, shot: Shot) -> tuple[Pieces, Floats]:
    """Place and colour of the objects of a shot, and their velocities (2, N, 2) px a frame at their ends."""
    frames, count = shot.stop - shot.start, len(shot.objects)
    area = np.zeros((frames, count), np.int32)
    box = np.full((frames, count, 4), np.nan, np.float32)
    velocity = np.full((frames - 1, count, 2), np.nan)
    colour: Ids | None = None
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        first, last = max(block.start, shot.start), min(block.stop, shot.stop)
        rows = slice(first - block.start, last - block.start)
        area[first - shot.start : last - shot.start, ids] = block.area[rows][:, keep]
        box[first - shot.start : last - shot.start, ids] = block.box[rows][:, keep]
        pairs = slice(first - block.start, min(last, shot.stop - 1) - block.start)
        velocity[first - shot.start :][: pairs.stop - pairs.start, ids] = block.velocity[pairs][:, keep]
        if colour is None:
            colour = np.zeros((count, block.colour.shape[1]), np.int64)
        colour[ids] += block.colour[keep]
    assert colour is not None
    return Pieces(area, box, colour), end_velocities(velocity)


def moving_objects(groups: Groups, start: int, stop: int) -> NDArray[np.bool_]:
    """(frames, all objects) whether each object moves at each of the frames ``start`` to ``stop - 1``."""
    out = np.zeros((stop - start, len(groups.group)), np.bool_)
    part = groups.of(start, stop)
    out[:, part.object] = part.moving
    return out


STAGE = Stage("groups", 5, task, Inputs, Sections, Groups, "video", cost=(0.5, 0.1))
