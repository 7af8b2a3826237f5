"""Stage ``groups``: what moves, with what, and when: window by window of every shot.

An object that several windows show keeps the group of the first in which it moves; in the others it rests, or is in the
group that this one goes on in. It reads the affinity and what lies beside it, and of the statistics the places of the objects.
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
from zsmoseg.grouping.numbering import carried_groups, carried_instances
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.grouping.remarks import together
from zsmoseg.motion.models import Floats
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, local_ids
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.statistics import Statistics
from zsmoseg.workflows.stages.windows import all_windows, block_of

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Groups(Arrays):
    """The answer: when objects move, a block a window; then what is known of each, in one block."""

    object: Ids = table("object", dtype="int64", meaning="object")
    group: Ids = table("object", dtype="int64", meaning="motion group, 0 = static")
    instance: Ids = table("object", dtype="int64", meaning="object that it is a piece of, 0 = static")
    frames: Ids = table("object", dtype="int64", meaning="frames in which it is seen", unit="frames")
    frames_moving: Ids = table("object", dtype="int64", meaning="frames in which it moves", unit="frames")
    area: Ids = table("object", dtype="int64", meaning="pixels as displayed, all frames", unit="px^2")
    excess: Floats = table(
        "object",
        dtype="float64",
        meaning="what one motion for it and the static world costs, mean over the pairs",
        unit="px",
    )
    tolerance: Floats = table("object", dtype="float64", meaning="what of that is tolerated", unit="px")
    reason: Ids = table(
        "object",
        dtype="int64",
        meaning="what decided that it moves or not (zsmoseg.grouping.decisions.Reason)",
    )
    moving: NDArray[np.bool_] = table(
        "frame", "object", dtype="bool", meaning="whether it moves at the frame"
    )
    margin: NDArray[np.float32] = table(
        "frame",
        "object",
        dtype="float32",
        meaning="ln of the odds against the static world: what it costs it, over what is tolerated",
    )
    window: Ids = table("window", dtype="int64", meaning="window, numbered through the video")
    first_frame: Ids = table("window", dtype="int64", meaning="its first frame")
    end_frame: Ids = table("window", dtype="int64", meaning="the frame after its last one")

    @property
    def world(self) -> Floats:
        """(object,) affinity with the static world: one half = at the tolerance; NaN = unknown."""
        return self.tolerance / (self.tolerance + self.excess)

    eigenvalue: Floats = table(
        "window", "rank", dtype="float64", meaning="of the normalised affinity, the largest first"
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
    """One window after the other; groups go on counting from shot to shot."""
    said: list[tuple[list[str], str]] = []
    grid, grouping = working_size(part.probe, s.frames.width), s.groups.parameters(Grouping)
    known = Known.of(int(inputs.objects.last_object[-1]) + 1)
    colours = read_colours(inputs.statistics, len(known.group))
    for number, window in enumerate(all_windows(inputs.objects, inputs.labels)):
        pieces, velocity = read_pieces(inputs.statistics, window, colours)
        whole = inputs.objects.whole[window.objects]
        answer = group_shot(read_affinity(inputs.affinity, window), pieces, velocity, whole, grid, grouping)
        said.append((answer.warnings, f"frames {window.start} to {window.stop - 1}"))
        rows = slice(window.first - window.start, window.last - window.start)
        moving = answer.moving[rows]
        known.add(window.objects, answer, pieces.area.sum(0).astype(np.float64), moving)
        yield Groups(
            start=window.first,
            stop=window.last,
            object=window.objects,
            moving=moving,
            margin=answer.margin[rows],
            window=np.array([number], np.int64),
            first_frame=np.array([window.start], np.int64),
            end_frame=np.array([window.stop], np.int64),
            eigenvalue=answer.eigenvalues[None],
        )
    part.facts["warnings"] = together(said)
    yield known.left(part.frames, *_displayed(inputs.labels, len(known.group)))


@dataclass
class Known:
    """What is known of every object (N) after some windows."""

    group: Ids
    instance: Ids
    frames_moving: Ids
    excess: Floats
    tolerance: Floats
    reason: Ids
    seen: NDArray[np.bool_]
    """Whether a window had it."""

    @classmethod
    def of(cls, count: int) -> Known:
        """Nothing yet."""
        group, instance, frames, reason = np.zeros((4, count), np.int64)
        excess, tolerance = np.full((2, count), np.nan)
        return cls(group, instance, frames, excess, tolerance, reason, np.zeros(count, np.bool_))

    def add(self, objects: Ids, answer: ShotGroups, support: Floats, moving: NDArray[np.bool_]) -> None:
        """The answer of a window for the ``objects`` in it: the first in which an object moves counts, or the first."""
        group = carried_groups(answer.group, self.group[objects], support, int(self.group.max()))
        instance = carried_instances(answer.instance, self.instance[objects], support, objects)
        new = ~self.seen[objects] | ((self.group[objects] == 0) & (group > 0))
        at = objects[new]
        self.group[at], self.instance[at], self.seen[at] = group[new], instance[new], True
        self.excess[at], self.tolerance[at] = answer.excess[new], answer.tolerance[new]
        self.reason[at] = answer.reason[new]
        self.frames_moving[objects] += moving.sum(0)

    def left(self, stop: int, frames: Ids, area: Ids) -> Groups:
        """All of it, with the frames in which each object is seen, and its pixels at the displayed size."""
        return Groups(
            start=0,
            stop=stop,
            object=np.arange(len(self.group)),
            group=self.group,
            instance=self.instance,
            frames=frames,
            frames_moving=self.frames_moving,
            area=area,
            excess=self.excess,
            tolerance=self.tolerance,
            reason=self.reason,
        )


def _displayed(labels: Labels, count: int) -> tuple[Ids, Ids]:
    """(objects,) frames in which each is seen, and its pixels at the displayed size."""
    frames, area = np.zeros((2, count), np.int64)
    for block in labels.blocks():
        frames[block.object] += (block.area > 0).sum(0)
        area[block.object] += block.area.sum(0)
    return frames, area


def read_affinity(affinity: Affinity, shot: Shot) -> ShotAffinity:
    """The affinity of a window and what lies beside it."""
    block = block_of(affinity, shot)
    return ShotAffinity(**{f.name: getattr(block, f.name) for f in fields(ShotAffinity)})


def read_colours(statistics: Statistics, count: int) -> Ids:
    """(objects, bins) px of each colour over the whole life of an object: statistics know them by the chunk only."""
    out: Ids | None = None
    for block in statistics.blocks():
        out = np.zeros((count, block.colour.shape[1]), np.int64) if out is None else out
        out[block.object] += block.colour
    assert out is not None
    return out


def read_pieces(statistics: Statistics, shot: Shot, colours: Ids) -> tuple[Pieces, Floats]:
    """Place and colour of the objects of a window, and their velocities (2, N, 2) px a frame at their ends."""
    frames, count = shot.stop - shot.start, len(shot.objects)
    area = np.zeros((frames, count), np.int32)
    box = np.full((frames, count, 4), np.nan, np.float32)
    velocity = np.full((frames - 1, count, 2), np.nan)
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        first, last = max(block.start, shot.start), min(block.stop, shot.stop)
        rows = slice(first - block.start, last - block.start)
        area[first - shot.start : last - shot.start, ids] = block.area[rows][:, keep]
        box[first - shot.start : last - shot.start, ids] = block.box[rows][:, keep]
        pairs = slice(first - block.start, min(last, shot.stop - 1) - block.start)
        velocity[first - shot.start :][: pairs.stop - pairs.start, ids] = block.velocity[pairs][:, keep]
    return Pieces(area, box, colours[shot.objects]), end_velocities(velocity)


def moving_objects(groups: Groups, start: int, stop: int) -> NDArray[np.bool_]:
    """(frames, all objects) whether each object moves at each of the frames ``start`` to ``stop - 1``."""
    out = np.zeros((stop - start, len(groups.group)), np.bool_)
    part = groups.of(start, stop)
    out[:, part.object] = part.moving
    return out


STAGE = Stage("groups", 8, task, Inputs, Sections, Groups, "video", cost=(0.5, 0.1))
