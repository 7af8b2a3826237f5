"""Stage ``labels`` of proposed masks: lookups; between frames with masks those are propagated along the flow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zsmoseg import settings
from zsmoseg.tracking.carrying import here, look_up, nearest_known, step
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, ignored, reach
from zsmoseg.workflows.stages.cues.flow import Flow, Vectors, between_cuts
from zsmoseg.workflows.stages.front_end import Labels, labels_of
from zsmoseg.workflows.stages.proposed.objects import MaskObjects, lookups
from zsmoseg.workflows.stages.proposed.proposals import Proposals


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    proposals: Proposals = reach(ALL)
    objects: MaskObjects = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Labels]:
    """Paint one chunk."""
    mask = ignored(s.ignore, *part.displayed)
    labels = np.zeros((part.stop - part.start, *part.displayed), np.uint16)
    for start, stop in between_cuts(inputs.flow.state):
        first, last = max(start, part.start), min(stop, part.stop)
        if first >= last:
            continue
        nearest = nearest_known(inputs.objects.known, start, stop)
        tables = lookups(inputs.objects, {int(t) for t in nearest[first - start : last - start] if t >= 0})
        for t in range(first, last):
            if (source := int(nearest[t - start])) >= 0:
                given = inputs.proposals.of(source, source + 1).mask[0]
                label = tables[source][given].astype(np.uint16)
                labels[t - part.start] = (
                    label if source == t else look_up(label, _path(inputs.flow, source, t))
                )
    if mask is not None:
        labels[:, mask] = 0
    yield labels_of(part.start, labels)


def _path(flow: Flow, source: int, frame: int) -> Vectors:
    """Where the pixels of ``frame`` lie in the frame ``source``, on the working grid."""
    between = range(source, frame) if source < frame else reversed(range(frame, source))
    where: Vectors | None = None
    for pair in between:
        vectors = flow.of(pair, pair + 1)
        one = (vectors.backward if source < frame else vectors.forward)[0]
        where = step(here(*one.shape[1:]) if where is None else where, one)
    assert where is not None
    return where


STAGE = Stage("labels", 2, task, Inputs, Sections, Labels, cost=(3.0, 5.0), memory=Memory(shown=4))
