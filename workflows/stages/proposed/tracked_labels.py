"""Stage ``labels`` of tracked masks: the tracks as pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zsmoseg import settings
from zsmoseg.formats.rle import mask_of, unpacked
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, ignored, reach
from zsmoseg.workflows.stages.front_end import Labels, labels_of
from zsmoseg.workflows.stages.proposed.tracks import Tracks


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    tracks: Tracks = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Labels]:
    """Paint one chunk."""
    mask = ignored(s.ignore, *part.displayed)
    labels = np.zeros((part.stop - part.start, *part.displayed), np.uint16)
    for block in inputs.tracks.of(part.start, part.stop).blocks():
        if not block.has("tracked"):
            continue
        frame_of = np.repeat(np.arange(block.start, block.stop), block.tracked)
        for t, n, rle in zip(
            frame_of, block.object_of, unpacked(block.length, block.run, part.displayed), strict=True
        ):
            if part.start <= t < part.stop:
                labels[t - part.start][mask_of(rle)] = n
    if mask is not None:
        labels[:, mask] = 0
    yield labels_of(part.start, labels)


STAGE = Stage("labels", 1, task, Inputs, Sections, Labels, cost=(5.0, 5.0), memory=Memory(shown=4))
