"""Stage ``affinity``: the residuals of all pairs of a shot as one similarity of its objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import Kernel, accumulate, normalised
from zsmoseg.grouping.fusion import fused
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import Span, local_ids, overlapping, spans
from zsmoseg.workflows.stage import ALL, Left, Stage, Task
from zsmoseg.workflows.stages.epipolar import each_pair


def task(task: Task) -> Left:
    """Per shot ``agreement``, ``together`` (cue, object, object), ``affinity`` (object, object), ``object`` (global ids)."""
    return Left(groups=_groups(task))


def _groups(task: Task) -> Iterator[tuple[str, Mapping[str, NDArray[Any]]]]:
    s = task.settings.affinity
    for span in spans(task.inputs["objects"]):
        views = [accumulate(pairs, len(span.objects), s.group(Kernel)) for pairs in _cues(task, span)]
        affinities = [normalised(*view) for view in views]
        one = len(views) == 1
        yield (
            span.name,
            {
                "object": span.objects,
                "agreement": np.stack([agreement for agreement, _ in views]),
                "together": np.stack([together for _, together in views]),
                "affinity": affinities[0]
                if one
                else fused(affinities, s.columns if s.fusion == "coregularised" else None),
            },
        )


def _cues(task: Task, span: Span) -> Iterator[Iterator[tuple[NDArray[np.int64], Any, Any]]]:
    """The residuals of each cue that is wanted."""
    cues = task.settings.affinity.cues
    if cues != "epipolar":
        yield each_residual(task.inputs["residuals"], span)
    if cues != "flow":
        yield each_pair(task.inputs["epipolar"], span)


def each_residual(residuals: Artifact, span: Span) -> Iterator[tuple[NDArray[np.int64], Any, Any]]:
    """Local ids, residuals and pixels of the valid pairs of a shot, in order."""
    for part, _, _ in overlapping(residuals, span.start, span.stop):
        for group in residuals.groups(part):
            table = residuals.read_table(part, group)
            keep, ids = local_ids(table["object"], span)
            for m, valid in enumerate(table["valid"], start=int(group)):
                if valid and span.start <= m < span.stop - 1:
                    k = m - int(group)
                    yield ids, table["residual"][k][np.ix_(keep, keep)], table["pixels"][k][keep]


STAGE = Stage(
    "affinity",
    2,
    task,
    inputs={"residuals": ALL, "objects": ALL},
    sections=("affinity",),
    scope="video",
    cost=(0.1, 0.1),
)
WITH_EPIPOLAR = replace(STAGE, inputs={**STAGE.inputs, "epipolar": ALL})
"""The same where ``affinity.cues`` asks for more than flow."""
