"""Stage ``affinity``: the residuals of all pairs of a shot as one similarity of its objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.affinity import accumulate, normalised
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import Span, local_ids, overlapping, spans
from zsmoseg.workflows.stage import ALL, Left, Stage, Task


def task(task: Task) -> Left:
    """Per shot ``agreement``, ``together``, ``affinity`` (object, object) and ``object`` (global ids)."""
    return Left(groups=_groups(task))


def _groups(task: Task) -> Iterator[tuple[str, Mapping[str, NDArray[Any]]]]:
    for span in spans(task.inputs["objects"]):
        pairs = each_residual(task.inputs["residuals"], span)
        agreement, together = accumulate(pairs, len(span.objects), task.settings.affinity)
        affinity = normalised(agreement, together)
        found = {"object": span.objects, "agreement": agreement, "together": together, "affinity": affinity}
        yield span.name, found


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
    1,
    task,
    inputs={"residuals": ALL, "objects": ALL},
    sections=("affinity",),
    scope="video",
    cost=(0.1, 0.1),
)
