"""Stage ``masks``: the images in the output folder: groups in ``masks``, objects in ``objects``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zsmoseg import settings
from zsmoseg.painting.numbers import paint_table
from zsmoseg.painting.palette import encode_png
from zsmoseg.stores import files
from zsmoseg.stores.output import place
from zsmoseg.video.probe import Probe
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.groups import Groups, moving_objects


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    labels: Labels = reach()
    groups: Groups = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    masks: settings.Masks


def names(probe: Probe, start: int, stop: int, s: Sections) -> list[str]:
    """The images of frames ``start`` to ``stop``, named like the frames."""
    return [f"{folder}/{name}.png" for name in probe.names[start:stop] for folder in ("masks", "objects")]


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Labels]:
    """Paint one chunk."""
    numbers = inputs.groups.group, inputs.groups.instance
    moving = moving_objects(inputs.groups, part.start, part.stop)
    written = {}
    left = iter(names(part.probe, part.start, part.stop, s))
    for label, state in zip(inputs.labels.label, moving, strict=True):
        groups, instances = (paint_table(number, state, s.masks.when) for number in numbers)
        image = encode_png(groups[label])
        other = image if np.array_equal(groups, instances) else encode_png(instances[label])
        for data, name in zip((image, other), left, strict=False):
            written[name] = files.write_noted(place(part.out, name), data)
    part.facts["files"] = written
    yield from ()


STAGE = Stage("masks", 2, task, Inputs, Sections, files=names, cost=(2.7, 4.0), memory=Memory(shown=1))
