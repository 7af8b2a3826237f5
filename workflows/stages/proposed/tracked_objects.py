"""Stage ``objects`` of tracked masks: the objects of each shot, and what networks call them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zsmoseg import settings
from zsmoseg.workflows.stage import ALL, Part, Stage, reach
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts
from zsmoseg.workflows.stages.front_end import shot_columns
from zsmoseg.workflows.stages.proposed.naming import categories
from zsmoseg.workflows.stages.proposed.objects import MaskObjects, labels_of_categories, named_objects
from zsmoseg.workflows.stages.proposed.proposals import Proposals
from zsmoseg.workflows.stages.proposed.tracks import Tracks


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    proposals: Proposals = reach(ALL)
    tracks: Tracks = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    proposals: settings.Proposals
    tags: settings.Tags


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[MaskObjects]:
    """All shots of the video."""
    last = list(map(int, inputs.tracks.largest))
    count = last[-1] + 1
    proposals = inputs.proposals
    yield MaskObjects(
        known=proposals.known,
        masks=proposals.masks,
        number=proposals.number,
        object_of=inputs.tracks.became,
        origin=np.zeros(count, np.int64),
        **named_objects(proposals, inputs.tracks.became, count, len(categories(s.proposals, s.tags))),
        **shot_columns(part.frames, between_cuts(inputs.flow.state), last),
    )


STAGE = Stage(
    "objects", 2, task, Inputs, Sections, MaskObjects, "video", labels=labels_of_categories, cost=(1.0, 0.1)
)
