"""Stage ``segments``: superpixels of every frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.proposals.embedded.superpixels import Superpixels, segment
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import video
from zsmoseg.workflows.stage import Memory, Part, Stage, reach
from zsmoseg.workflows.stages.cues.frames import Frames


@dataclass(frozen=True)
class Segments(Arrays):
    """The superpixels, numbered from 0 in every frame."""

    segment: NDArray[np.uint16] = video(
        "frame", "y", "x", dtype="uint16", meaning="superpixel of the pixel", codec="label"
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    segments: settings.Segments


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Segments]:
    """Superpixels of one chunk."""
    superpixels = s.segments.parameters(Superpixels)
    found = np.stack([segment(image, superpixels) for image in inputs.frames.image])
    yield Segments(start=part.start, stop=part.stop, segment=found)


STAGE = Stage("segments", 2, task, Inputs, Sections, Segments, cost=(7.0, 27.0), memory=Memory(working=12))
