"""Stage ``proposals``: masks that are given, as they are, frame by frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from zsmoseg import settings
from zsmoseg.workflows.imports.contents import masks_of, passed_over
from zsmoseg.workflows.stage import Memory, Part, Stage
from zsmoseg.workflows.stages.proposed.proposals import Proposals, proposals_of


@dataclass(frozen=True)
class Inputs:
    """Nothing: the files are read."""


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    video: settings.Video
    proposals: settings.Proposals


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Proposals]:
    """The masks of one chunk; facts: pixels that lie under others, what was left out, by the first what is of no frame."""
    found = list(masks_of(s.proposals, part.probe, part.start, part.stop))
    seen = [masks for masks in found if masks is not None]
    facts = passed_over("proposals", s.proposals, part.probe) if not part.start else {"left_out": {}}
    left_out = sum((masks.left_out for masks in seen), Counter(facts["left_out"]))
    part.facts.update(facts, left_out=dict(left_out), hidden=sum(masks.hidden for masks in seen))
    yield proposals_of(part.start, found, part.displayed)


STAGE = Stage("proposals", 3, task, Inputs, Sections, Proposals, cost=(6.0, 8.0), memory=Memory(shown=6))
