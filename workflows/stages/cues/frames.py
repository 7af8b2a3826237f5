"""Stage ``frames``: the source decoded once, at the working size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import video
from zsmoseg.workflows.stage import Memory, Part, Stage, working_size


@dataclass(frozen=True)
class Frames(Arrays):
    """The pictures."""

    image: NDArray[np.uint8] = video(
        "frame", "y", "x", "channel", dtype="uint8", meaning="frame at the working size, blue green red"
    )


@dataclass(frozen=True)
class Inputs:
    """Nothing: the source is read."""


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    video: settings.Video
    frames: settings.Frames


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Frames]:
    """Decode and resize the frames of one chunk."""
    height, width = working_size(part.probe, s.frames.width)
    images = part.images(part.start, part.stop)
    small = [cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) for image in images]
    yield Frames(start=part.start, stop=part.stop, image=np.asarray(np.stack(small), np.uint8))


STAGE = Stage("frames", 4, task, Inputs, Sections, Frames, cost=(1.7, 302.7), memory=Memory(working=14))
