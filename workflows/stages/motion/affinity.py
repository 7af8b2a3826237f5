"""Stage ``affinity``: the residuals of all pairs of a window as one similarity of its objects, and who is static."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.affinity import Kernel, Views, shot_affinity
from zsmoseg.grouping.world import Pair
from zsmoseg.motion.models import MODELS, Floats
from zsmoseg.motion.residuals import PairResiduals
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach
from zsmoseg.workflows.stages.front_end import Labels, Objects, Shot, local_ids
from zsmoseg.workflows.stages.motion.epipolar import Epipolar, each_view_pair
from zsmoseg.workflows.stages.motion.residuals import Residuals
from zsmoseg.workflows.stages.motion.statistics import Statistics
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

    def visibilities(self, count: int) -> Floats:
        """(count,) the visibility of the objects by their number; NaN where no window has one."""
        out = np.full(count, np.nan)
        out[self.object] = self.visibility
        return out


@dataclass(frozen=True)
class Inputs:
    """What is read."""

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

    motion: settings.Motion
    affinity: settings.Affinity


def cues(s: Sections) -> Mapping[str, Sequence[str]]:
    """The names of the cues."""
    return {"cue": ("flow", "epipolar") if s.affinity.cues == "both" else (s.affinity.cues,)}


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Affinity]:
    """The affinity of every window of every shot."""
    model, kernel = MODELS[s.motion.model], s.affinity.parameters(Kernel)
    for window in all_windows(inputs.objects, inputs.labels):
        size = window.stop - window.start - 1, len(window.objects)
        visibility = read_visibility(inputs.statistics, window)
        found = shot_affinity(_pairs(inputs, window), size, model, kernel, visibility, _views(inputs, window))
        yield Affinity(
            start=window.start,
            stop=window.stop,
            object=window.objects,
            affinity=found.affinity,
            agreement=found.agreement,
            together=found.together,
            pairs=found.pairs,
            static=found.static,
            visibility=visibility,
            excess=found.excess,
            tolerance=found.tolerance,
            weight=found.weight,
        )


def _pairs(inputs: Inputs, shot: Shot) -> Callable[[], Iterator[Pair]]:
    def pairs() -> Iterator[Pair]:
        return each_pair(inputs.statistics, inputs.residuals, shot)

    return pairs


def _views(inputs: Inputs, shot: Shot) -> Views:
    return each_view_pair(inputs.epipolar, shot) if isinstance(inputs, InputsWithEpipolar) else ()


def each_pair(statistics: Statistics, residuals: Residuals, shot: Shot) -> Iterator[Pair]:
    """The valid pairs of a shot, numbered from its start, with local ids."""
    sums, left = (x.of(shot.start, shot.stop).blocks() for x in (statistics, residuals))
    for measured, block in zip(sums, left, strict=True):
        keep, ids = local_ids(block.object, shot)
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
                yield Pair(number, ids, measured.gram[k][keep], float(measured.noise[k]), found)


def read_visibility(statistics: Statistics, shot: Shot) -> Floats:
    """(objects of the shot,) what the world's motion leaves unexplained over what the flow does."""
    total = np.zeros((len(shot.objects), 2))
    for block in statistics.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for k, values in enumerate(block.unexplained):
            if shot.start <= block.start + k < shot.stop - 1:
                total[ids] += values[keep]
    return np.asarray(total[:, 0] / np.maximum(total[:, 1], UNCHANGED))


STAGE = Stage("affinity", 6, task, Inputs, Sections, Affinity, "video", labels=cues, cost=(0.5, 0.1))
WITH_EPIPOLAR = Stage(
    "affinity", 6, task, InputsWithEpipolar, Sections, Affinity, "video", labels=cues, cost=(0.5, 0.1)
)
"""The same where ``affinity.cues`` asks for more than flow."""
