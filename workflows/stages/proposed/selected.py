"""Stage ``proposals`` of networks: which candidates become masks; no network runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.formats.overlaps import FrameMasks, stack
from zsmoseg.formats.rle import area, mask_of, overlaps_of, unpacked
from zsmoseg.proposals.candidates import Criteria, chosen
from zsmoseg.workflows.stage import Memory, Part, Stage, reach
from zsmoseg.workflows.stages.proposed.detections import Detections
from zsmoseg.workflows.stages.proposed.looks import span_of
from zsmoseg.workflows.stages.proposed.naming import categories
from zsmoseg.workflows.stages.proposed.proposals import Proposals, proposals_of

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    detections: Detections = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    looks: settings.Looks
    proposals: settings.Proposals
    tags: settings.Tags
    selection: settings.Selection


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Proposals]:
    """The masks of one chunk; facts: ``hidden`` px below others, ``dropped`` candidates."""
    names = categories(s.proposals, s.tags)
    found: dict[int, tuple[FrameMasks, Ids]] = {}
    dropped = 0
    for block in inputs.detections.blocks():
        ends, bytes_at = np.cumsum([0, *block.candidates]), np.cumsum([0, *block.length])
        for k in np.flatnonzero(block.looked):
            rows = slice(ends[k], ends[k + 1])
            if part.start <= (t := int(k) + block.start) < part.stop:
                runs = block.run[bytes_at[rows.start] : bytes_at[rows.stop]]
                masks = unpacked(block.length[rows], runs, part.displayed)
                found[t] = _frame(block, rows, masks, part.displayed, s, names)
                dropped += rows.stop - rows.start - len(found[t][1])
    frames = [found.get(t, (None, np.zeros(0, np.int64))) for t in range(part.start, part.stop)]
    part.facts["hidden"] = sum(f.hidden for f, _ in frames if f is not None)
    part.facts["dropped"] = int(dropped)
    yield proposals_of(
        part.start, [f for f, _ in frames], part.displayed, [category for _, category in frames], len(names)
    )


def _frame(
    found: Detections,
    rows: slice,
    masks: list[dict[str, object]],
    size: tuple[int, int],
    s: Sections,
    names: Sequence[str],
) -> tuple[FrameMasks, Ids]:
    """The masks of one frame on each other, the better on top, and their categories."""
    denied = {word.casefold() for word in s.selection.deny}
    allowed = np.array([name.casefold() not in denied for name in names] + [False])
    # what is denied counts for nothing, as if nobody had looked for it: the best of the others is left
    scores = np.where(allowed[found.category_of[rows]], found.score[rows], 0.0)
    best = scores.argmax(1)
    each = np.arange(len(best))
    category, score = found.category_of[rows][each, best], scores[each, best].astype(np.float32)
    kept = chosen(
        score,
        found.quality[rows],
        found.stability[rows],
        np.array([area(mask) for mask in masks]),
        overlaps_of(masks),
        size[0] * size[1],
        s.selection.parameters(Criteria),
    )
    return stack([mask_of(masks[n]) for n in kept], size, scores=score[kept].tolist()), category[kept]


def _labels(s: Sections) -> Mapping[str, Sequence[str]]:
    return {"category": categories(s.proposals, s.tags)}


STAGE = Stage(
    "proposals",
    1,
    task,
    Inputs,
    Sections,
    Proposals,
    labels=_labels,
    span=span_of,
    cost=(10.0, 8.0),
    memory=Memory(shown=6),
)
