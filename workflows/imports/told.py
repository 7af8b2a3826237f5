"""What came in with an import, in words: frames, pixels, and all that was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zsmoseg.formats.overlaps import left_out_words
from zsmoseg.formats.track_ids import ids_in_order
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.stages.proposed.objects import HIGHEST
from zsmoseg.workflows.stages.proposed.proposals import Proposals

if TYPE_CHECKING:
    from zsmoseg.workflows.planning.plan import VideoPlan

Facts = Mapping[str, Any]


def brought_lines(plan: VideoPlan) -> list[str]:
    """A line for each cue that was brought for a finished video: where from, what there is of it, what was left out."""
    found = {kind: plan.stages[kind].artifact for kind in plan.brought if kind in plan.stages}
    return [
        f"{kind} from {plan.brought[kind].path} ({plan.brought[kind].fingerprint}): "
        + told(kind, artifact, len(plan.probe.times), plan.brought[kind].kind == "ids")
        for kind, artifact in found.items()
        if artifact is not None
    ]


def told(kind: str, artifact: Artifact, frames: int, ids: bool) -> str:
    """What there is of a cue, what was left out, how it was understood.

    Parameters
    ----------
    kind : ``proposals``, ``flow`` or ``depth``.
    frames : of the video.
    ids : whether the masks have ids through the video.
    """
    records = [artifact.part(part) for part in range(len(artifact.parts))]
    facts = [record.facts for record in records if record is not None]
    left_out = sum((Counter(found.get("left_out", {})) for found in facts), Counter())
    notes = [note for found in facts for note in found.get("notes", [])]
    if ids:
        notes += _numbered(artifact)
    there = _masks(artifact, facts, frames) if kind == "proposals" else _numbers(kind, facts, frames)
    return "; ".join([there + left_out_words(left_out), *notes])


def _masks(artifact: Artifact, facts: Sequence[Facts], frames: int) -> str:
    known = int(Proposals.read(artifact).known.sum())
    hidden = sum(found["hidden"] for found in facts)
    rest = "" if known == frames else "; the frames between are filled along the flow"
    return f"masks on {known} of {frames} frames{rest}; {hidden} px hidden below others"


def _numbered(artifact: Artifact) -> list[str]:
    """That ids are too sparse to be kept."""
    found = np.unique(Proposals.read(artifact).number)
    return [ids_in_order(found.tolist())] if found.size and found[-1] > HIGHEST else []


def _numbers(kind: str, facts: Sequence[Facts], frames: int) -> str:
    unknown, pixels = (sum(found.get(name, 0) for found in facts) for name in ("unknown", "pixels"))
    what = f"{frames - 1} pairs" if kind == "flow" else f"{frames} maps"
    return f"{what}, {100 * unknown / max(pixels, 1):.1f} % of the pixels unknown"
