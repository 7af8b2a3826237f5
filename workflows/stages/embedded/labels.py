"""Stage ``labels``: the object of every pixel, at the displayed size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zsmoseg import settings
from zsmoseg.proposals.embedded.guided_filter import GuidedFilter
from zsmoseg.proposals.embedded.upsampling import paint
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, ignored, reach
from zsmoseg.workflows.stages.cues.frames import Frames
from zsmoseg.workflows.stages.embedded.objects import SuperpixelObjects, each_frame
from zsmoseg.workflows.stages.embedded.segments import Segments
from zsmoseg.workflows.stages.front_end import Labels, labels_of


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach()
    segments: Segments = reach()
    objects: SuperpixelObjects = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    labels: settings.Labels
    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Labels]:
    """Paint one chunk."""
    mask = ignored(s.ignore, *part.displayed)
    labels = np.zeros((part.stop - part.start, *part.displayed), np.uint16)
    found = each_frame(inputs.objects, part.start, part.stop)
    pictures = zip(labels, inputs.frames.image, inputs.segments.segment, found, strict=True)
    guided = s.labels.parameters(GuidedFilter)
    for label, image, segment, ids in pictures:
        label[:] = paint(image, segment, ids, part.displayed, guided)
        if mask is not None:
            label[mask] = 0
    yield labels_of(part.start, labels)


STAGE = Stage("labels", 2, task, Inputs, Sections, Labels, cost=(4.2, 1.3), memory=Memory(working=6, shown=4))
