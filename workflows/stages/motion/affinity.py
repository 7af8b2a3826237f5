"""Stage ``affinity``: the residuals of all pairs of a window as one similarity of its objects, and who is static."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.affinity import Kernel, ShotAffinity, Views, shot_affinity
from zsmoseg.grouping.geometry import VERDICTS, Geometry, Limits, geometry_of
from zsmoseg.grouping.world import Pair
from zsmoseg.motion.models import MODELS, Floats
from zsmoseg.motion.residuals import PairResiduals
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, ignored, reach, working_size
from zsmoseg.workflows.stages.cues.flow import READ, Flow
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, local_ids
from zsmoseg.workflows.stages.motion.epipolar import Epipolar, each_view_pair
from zsmoseg.workflows.stages.motion.residuals import Residuals
from zsmoseg.workflows.stages.motion.statistics import Statistics
from zsmoseg.workflows.stages.motion.tracked import tracked
from zsmoseg.workflows.stages.windows import all_windows

UNCHANGED = 1e-9
"""Change of the image (grey levels^2 px) that counts as none: a divisor above 0."""


@dataclass(frozen=True)
class Affinity(Arrays):
    """The similarity of the objects of a window of a shot; a block is a window. Objects that no window shows have none."""

    object: NDArray[np.int64] = table("object", dtype="int64", meaning="object")
    affinity: Floats = table(
        "object",
        "other",
        dtype="float64",
        meaning="similarity of two objects, 0 to 1; of the background: of the static world",
    )
    agreement: Floats = table(
        "cue",
        "object",
        "other",
        dtype="float64",
        meaning="kernel, summed over pairs of frames with its weight",
        add=True,
    )
    together: Floats = table(
        "cue",
        "object",
        "other",
        dtype="float64",
        meaning="its weight: how much the two are seen together",
        add=True,
    )
    pairs: NDArray[np.int64] = table(
        "object", "other", dtype="int64", meaning="pairs of frames in which both are seen", add=True
    )
    static: NDArray[np.bool_] = table(
        "object", dtype="bool", meaning="whether it belongs to the static world"
    )
    visibility: Floats = table(
        "object",
        dtype="float64",
        meaning="what the world's motion leaves of its image, over what its flow leaves",
    )
    excess: Floats = table(
        "pair", "object", dtype="float64", meaning="what one motion for it and the world costs", unit="px"
    )
    tolerance: Floats = table(
        "pair", "object", dtype="float64", meaning="what of that is tolerated", unit="px"
    )
    weight: Floats = table(
        "pair",
        "object",
        dtype="float64",
        meaning="what it counts against the world: root of the pixels that count, 0 = for nothing",
        unit="px",
        fill=0,
    )

    verdict: NDArray[np.int8] = table(
        "object",
        dtype="int8",
        meaning="whether it obeys the geometry of the static world and stands on it: "
        + ", ".join(f"{number} = {text}" for number, text in enumerate(VERDICTS)),
    )
    counts: NDArray[np.bool_] = table(
        "object", dtype="bool", meaning="whether its evidence counts beside what obeys that geometry"
    )
    front: Floats = table(
        "object",
        dtype="float64",
        meaning="part of the world that is in front of the camera, by that geometry",
    )
    error: Floats = table(
        "object",
        dtype="float64",
        meaning="distance from the epipolar lines of the world, over the world's own",
    )
    parallax: Floats = table(
        "object", dtype="float64", meaning="parallax, over what nine tenths of the world stay below"
    )
    foot: Floats = table(
        "object",
        dtype="float64",
        meaning="part of the looks in which its foot is as near as the world below it",
    )
    beside: Floats = table(
        "object",
        dtype="float64",
        meaning="inverse depth of its foot, over that of the world beside it",
    )

    def evidence(self, count: int) -> dict[str, NDArray[Any]]:
        """By name the evidence (count,) for all objects by their number; NaN, or 0, where no window has one.

        ``geometry`` is the verdict in words.
        """
        out = {}
        for name in ("visibility", "verdict", "counts", "front", "error", "parallax", "foot", "beside"):
            values = getattr(self, name)
            out[name] = np.full(count, np.nan if values.dtype.kind == "f" else 0, values.dtype)
            out[name][self.object] = values
        return {**out, "geometry": np.array(VERDICTS)[out.pop("verdict")]}


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    flow: Flow = reach(ALL)
    statistics: Statistics = reach(ALL)
    residuals: Residuals = reach(ALL)
    labels: Labels = reach(ALL)
    objects: Objects = reach(ALL)


@dataclass(frozen=True)
class InputsWithEpipolar(Inputs):
    """The same where ``affinity.cues`` asks for more than flow."""

    epipolar: Epipolar = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    ignore: settings.Ignore
    motion: settings.Motion
    affinity: settings.Affinity


def cues(s: Sections) -> Mapping[str, Sequence[str]]:
    """The names of the cues."""
    return {"cue": ("flow", "epipolar") if s.affinity.cues == "both" else (s.affinity.cues,)}


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Affinity]:
    """The affinity of every window of every shot."""
    grid = working_size(part.probe, s.frames.width)
    ignore = ignored(s.ignore, *grid)
    for window in all_windows(inputs.objects, inputs.labels):
        yield of_window(inputs, window, s, grid, ignore)


def of_window(
    inputs: Inputs, window: Shot, s: Sections, grid: tuple[int, int], ignore: NDArray[np.bool_] | None
) -> Affinity:
    """The affinity of one window; where something would move, what obeys the geometry of the world joins the world."""
    model, kernel = MODELS[s.motion.model], s.affinity.parameters(Kernel)
    size = window.stop - window.start - 1, len(window.objects)
    visibility = read_visibility(inputs.statistics, window)

    def affinity(geometry: Geometry | None) -> ShotAffinity:
        pairs, views = _pairs(inputs, window), _views(inputs, window)
        return shot_affinity(pairs, size, model, kernel, visibility, views, geometry)

    found, geometry = affinity(None), Geometry.unasked(size[1])
    if s.affinity.acts("geometry") and s.affinity.geometry and not found.static.all():
        looks = tracked(inputs.flow, inputs.labels, window, grid, ignore)
        geometry = geometry_of(looks, ~found.static, grid, s.affinity.parameters(Limits))
        found = affinity(geometry)
    return _left(window, found, geometry, visibility)


def _left(window: Shot, found: ShotAffinity, geometry: Geometry, visibility: Floats) -> Affinity:
    """What is left of a window."""
    front = np.full(len(window.objects), geometry.front)
    tables = {**vars(found), **vars(geometry), "front": front, "visibility": visibility}
    return Affinity(start=window.start, stop=window.stop, object=window.objects, **tables)


def _pairs(inputs: Inputs, shot: Shot) -> Callable[[], Iterator[Pair]]:
    def pairs() -> Iterator[Pair]:
        return each_pair(inputs.statistics, inputs.residuals, shot)

    return pairs


def _views(inputs: Inputs, shot: Shot) -> Views:
    return each_view_pair(inputs.epipolar, shot) if isinstance(inputs, InputsWithEpipolar) else ()


def each_pair(statistics: Statistics, residuals: Residuals, shot: Shot) -> Iterator[Pair]:
    """The valid pairs of a shot, numbered from its start, with local ids."""
    for block in residuals.of(shot.start, shot.stop).blocks():
        # Kept residuals may have other blocks than sums that were made again with another length of the chunks.
        measured = statistics.of(block.start, block.stop)
        keep, ids = local_ids(block.object, shot)
        rows = np.flatnonzero(
            np.isin(measured.object, block.object[keep])
        )  # one that is not there shows by the shape
        for k in np.flatnonzero(block.valid):
            if shot.start <= block.start + k < shot.stop - 1:
                at = np.ix_(keep, keep)
                found = PairResiduals(
                    block.pixels[k][keep],
                    block.own[k][keep],
                    block.merge[k][at],
                    block.residual[k][at],
                    block.coefficient[k][keep],
                )
                number = int(block.start + k) - shot.start
                yield Pair(number, ids, measured.gram[k][rows], float(measured.noise[k]), found)


def read_visibility(statistics: Statistics, shot: Shot) -> Floats:
    """(objects of the shot,) what the world's motion leaves unexplained over what the flow does."""
    total = np.zeros((len(shot.objects), 2))
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for k, values in enumerate(block.unexplained):
            if shot.start <= block.start + k < shot.stop - 1:
                total[ids] += values[keep]
    return np.asarray(total[:, 0] / np.maximum(total[:, 1], UNCHANGED))


MEMORY: Memory[Sections] = Memory(working=65, frames=lambda s: READ)
"""Where something would move: the flow that tracks are followed along."""
STAGE = Stage(
    "affinity", 15, task, Inputs, Sections, Affinity, "video", labels=cues, cost=(6.2, 0.1), memory=MEMORY
)
WITH_EPIPOLAR = Stage(
    "affinity",
    15,
    task,
    InputsWithEpipolar,
    Sections,
    Affinity,
    "video",
    labels=cues,
    cost=(6.2, 0.1),
    memory=MEMORY,
)
"""The same where ``affinity.cues`` asks for more than flow."""
