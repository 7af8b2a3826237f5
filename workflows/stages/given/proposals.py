"""Stage ``proposals``: masks that are given, as they are, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table, video
from zsmoseg.workflows.imports.contents import masks_of
from zsmoseg.workflows.stage import Part, Stage


@dataclass(frozen=True)
class Proposals(Arrays):
    """The masks of every frame that has some."""

    mask: NDArray[np.uint16] = video(
        "frame",
        "y",
        "x",
        dtype="uint16",
        meaning="number of the mask at the pixel, 0 = none",
        grid="displayed",
        codec="label",
    )
    known: NDArray[np.bool_] = table("frame", dtype="bool", meaning="whether there are masks of the frame")
    masks: NDArray[np.int64] = table("frame", dtype="int64", meaning="how many masks it has")
    number: NDArray[np.int64] = table(
        "mask_of_frame", dtype="int64", meaning="number of the mask, frame by frame"
    )


@dataclass(frozen=True)
class Inputs:
    """Nothing: the files are read."""


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    video: settings.Video
    proposals: settings.Proposals


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Proposals]:
    """The masks of one chunk; the fact ``hidden`` counts those that lie wholly under others."""
    found = list(masks_of(s.proposals, part.probe, part.start, part.stop))
    empty = np.zeros(part.displayed, np.uint16)
    labels = np.stack([empty if f is None else f.label for f in found])
    numbers = [np.unique(label[label > 0]).astype(np.int64) for label in labels]
    part.facts["hidden"] = sum(0 if f is None else f.hidden for f in found)
    yield Proposals(
        start=part.start,
        stop=part.stop,
        mask=labels,
        known=np.array([f is not None for f in found]),
        masks=np.array([len(n) for n in numbers], np.int64),
        number=np.concatenate([np.zeros(0, np.int64), *numbers]),
    )


STAGE = Stage("proposals", 2, task, Inputs, Sections, Proposals, cost=(6.0, 8.0))
