"""Stage ``overlay``: the video with the moving groups in colour."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.painting.numbers import paint_table
from zsmoseg.painting.overlay import LONGEST as WIDEST
from zsmoseg.painting.overlay import encoded_size, fitted, overlay
from zsmoseg.stores import files
from zsmoseg.stores.output import place
from zsmoseg.video.decoding import media
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.groups import Groups, moving_objects

NAME = "overlay.mp4"
BLOCK = 16
"""Frames held in memory at once."""
STILL = 0.04
"""Seconds that the only frame of a video is shown."""
SHORTEST, LONGEST, DENOMINATOR = 1e-3, 10.0, 1001
"""Seconds between two frames at least and at most, and the denominator of the rate at most: that of 29.97 is 1001."""


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    labels: Labels = reach(ALL)
    groups: Groups = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    masks: settings.Masks
    overlay: settings.Overlay


def names(probe: Probe, start: int, stop: int, s: Sections) -> list[str]:
    """The one file, unless it is not wanted."""
    return [NAME] if s.overlay.write else []


def scaled_words(probe: Probe) -> list[str]:
    """That the overlay is smaller than the frames, in words; nothing where it is not."""
    if max(probe.height, probe.width) <= WIDEST:
        return []
    height, width = encoded_size(probe.height, probe.width)
    return [
        f"overlay: scaled to {width} x {height} px, H.264 takes sides of {WIDEST} px at most; masks are not scaled"
    ]


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Labels]:
    """Decode the source, colour what moves, encode H.264 that browsers play."""
    part.facts["files"] = {}
    if s.overlay.write:
        path = place(part.out, NAME)
        with files.appearing(path) as partial:
            _encode(partial, part, _painted(part, inputs, s))
        part.facts["files"] = {NAME: files.noted(path)}
    yield from ()


def _painted(part: Part, inputs: Inputs, s: Sections) -> Iterator[NDArray[np.uint8]]:
    """The coloured frames (H, W, 3)."""
    images = part.images(part.start, part.stop)
    for first in range(part.start, part.stop, BLOCK):
        last = min(first + BLOCK, part.stop)
        moving = moving_objects(inputs.groups, first, last)
        for label, state in zip(inputs.labels.of(first, last).label, moving, strict=True):
            mask = paint_table(inputs.groups.group, state, s.masks.when)[label]
            yield overlay(next(images), mask)


def _encode(path: Path, part: Part, images: Iterator[NDArray[np.uint8]]) -> None:
    with av.open(media(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=_rate(part.probe))
        stream.height, stream.width = encoded_size(part.probe.height, part.probe.width)
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "23", "threads": "1"}
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(fitted(image), "bgr24")):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)


def _rate(probe: Probe) -> Fraction:
    """Frames a second, from the median distance of the frames."""
    step = float(np.median(np.diff(probe.times))) if len(probe.times) > 1 else STILL
    return Fraction(1 / min(max(step, SHORTEST), LONGEST)).limit_denominator(DENOMINATOR)


STAGE = Stage(
    "overlay",
    2,
    task,
    Inputs,
    Sections,
    scope="video",
    files=names,
    cost=(5.6, 25.0),
    memory=Memory(shown=4, frames=lambda s: BLOCK),
)
