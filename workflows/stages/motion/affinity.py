"""Stage ``affinity``: the residuals of all pairs of a shot as one similarity of its objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.affinity import Kernel, accumulate, normalised
from zsmoseg.grouping.fusion import fused
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import ALL, Part, Stage, reach
from zsmoseg.workflows.stages.front_end import Objects, Shot, local_ids, shots_of
from zsmoseg.workflows.stages.motion.epipolar import Epipolar, each_view_pair
from zsmoseg.workflows.stages.motion.residuals import Residuals

Floats = NDArray[np.float64]
Pairs = Iterator[tuple[NDArray[np.int64], Floats, Floats]]


@dataclass(frozen=True)
class Affinity(Arrays):
    """The similarity of the objects of a shot; a block is a shot. Objects of different shots have none."""

    object: NDArray[np.int64] = table("object", dtype="int64", meaning="object")
    agreement: Floats = table(
        "cue", "object", "other", dtype="float64", meaning="kernel, summed over pairs of frames", add=True
    )
    together: Floats = table(
        "cue",
        "object",
        "other",
        dtype="float64",
        meaning="its weight: how much the two are seen together",
        add=True,
    )
    affinity: Floats = table("object", "other", dtype="float64", meaning="similarity of two objects, 0 to 1")


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    residuals: Residuals = reach(ALL)
    objects: Objects = reach(ALL)


@dataclass(frozen=True)
class InputsWithEpipolar(Inputs):
    """The same where ``affinity.cues`` asks for more than flow."""

    epipolar: Epipolar = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    affinity: settings.Affinity


def cues(s: Sections) -> Mapping[str, Sequence[str]]:
    """The names of the cues."""
    return {"cue": ("flow", "epipolar") if s.affinity.cues == "both" else (s.affinity.cues,)}


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Affinity]:
    """The affinity of every shot."""
    a, kernel = s.affinity, s.affinity.parameters(Kernel)
    for shot in shots_of(inputs.objects):
        views = [accumulate(pairs, len(shot.objects), kernel) for pairs in _pairs(inputs, shot, s)]
        affinities = [normalised(*view) for view in views]
        columns = a.columns if a.fusion == "coregularised" else None
        yield Affinity(
            start=shot.start,
            stop=shot.stop,
            object=shot.objects,
            agreement=np.stack([agreement for agreement, _ in views]),
            together=np.stack([together for _, together in views]),
            affinity=affinities[0] if len(views) == 1 else fused(affinities, columns),
        )


def _pairs(inputs: Inputs, shot: Shot, s: Sections) -> Iterator[Pairs]:
    """The residuals of each cue that is wanted."""
    if s.affinity.cues != "epipolar":
        yield each_residual(inputs.residuals, shot)
    if isinstance(inputs, InputsWithEpipolar) and s.affinity.cues != "flow":
        yield each_view_pair(inputs.epipolar, shot)


def each_residual(residuals: Residuals, shot: Shot) -> Pairs:
    """Local ids, residuals and pixels of the valid pairs of a shot, in order."""
    for block in residuals.of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for k in np.flatnonzero(block.valid):
            if shot.start <= block.start + k < shot.stop - 1:
                yield ids, block.residual[k][np.ix_(keep, keep)], block.pixels[k][keep]


STAGE = Stage("affinity", 3, task, Inputs, Sections, Affinity, "video", labels=cues, cost=(0.1, 0.1))
WITH_EPIPOLAR = Stage(
    "affinity", 3, task, InputsWithEpipolar, Sections, Affinity, "video", labels=cues, cost=(0.1, 0.1)
)
"""The same where ``affinity.cues`` asks for more than flow."""
