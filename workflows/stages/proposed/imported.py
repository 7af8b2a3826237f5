"""Stage ``proposals``: masks that are given, as they are, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from zsmoseg import settings
from zsmoseg.workflows.imports.contents import masks_of
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
    """The masks of one chunk; the fact ``hidden`` counts those that lie wholly under others."""
    found = list(masks_of(s.proposals, part.probe, part.start, part.stop))
    part.facts["hidden"] = sum(0 if f is None else f.hidden for f in found)
    yield proposals_of(part.start, found, part.displayed)


STAGE = Stage("proposals", 2, task, Inputs, Sections, Proposals, cost=(6.0, 8.0), memory=Memory(shown=6))
