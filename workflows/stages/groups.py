"""Stage ``groups``: what moves, with what, and when: shot by shot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.evidence import PairGrams
from zsmoseg.grouping.groups import ShotGroups, group_shot
from zsmoseg.linking import Pieces
from zsmoseg.stores.artifact import Artifact
from zsmoseg.workflows.reading import Span, local_ids, overlapping, spans
from zsmoseg.workflows.stage import ALL, Left, Stage, Task

Tables = Mapping[str, NDArray[Any]]


def task(task: Task) -> Left:
    """Columns by object for the whole video; per shot the motion state of every frame."""
    summary: dict[str, NDArray[Any]] = {}
    facts: dict[str, Any] = {}
    return Left(tables=summary, groups=_shots(task, summary, facts), facts=facts)


def _shots(
    task: Task, summary: dict[str, NDArray[Any]], facts: dict[str, Any]
) -> Iterator[tuple[str, Tables]]:
    """One shot after the other; ``summary`` and ``facts`` are filled at the end."""
    columns: dict[str, list[NDArray[Any]]] = {}
    warnings: list[str] = []
    found = spans(task.inputs["objects"])
    frames, area = _displayed(task.inputs["labels"], max(int(span.objects[-1]) for span in found) + 1)
    groups = things = 0
    for span in found:
        visibility = read_visibility(task.inputs["statistics"], span)
        answer = _group(task, span, visibility)
        warnings += [
            text if len(found) == 1 else f"frames {span.start} to {span.stop - 1}: {text}"
            for text in answer.warnings
        ]
        own = slice(0 if not columns else 1, None)
        for name, values in {**_columns(answer, groups, things), "visibility": visibility}.items():
            columns.setdefault(name, []).append(values[own])
        groups, things = groups + int(answer.group.max()), things + int(answer.thing.max())
        yield (
            f"shot-{span.start:08d}-{span.stop:08d}",
            {
                "object": span.objects,
                "moving": answer.moving,
                "margin": answer.margin,
                "eigenvalue": answer.eigenvalues,
                "cell": answer.decision.evidence.cells,
            },
        )
    summary.update({name: np.concatenate(parts) for name, parts in columns.items()})
    summary.update(frames=frames, area=area)
    facts["warnings"] = warnings


def _group(task: Task, span: Span, visibility: NDArray[np.float64]) -> ShotGroups:
    statistics = task.inputs["statistics"]

    def shot() -> Iterator[PairGrams]:
        return each_pair(statistics, span)

    affinity = task.inputs["affinity"].read_table(0, span.name)["affinity"]
    pieces = read_pieces(statistics, span)
    model = task.settings.motion.model
    return group_shot(shot, pieces, affinity, task.grid, model, task.settings.groups, visibility)


def _columns(answer: ShotGroups, groups: int, things: int) -> dict[str, NDArray[Any]]:
    """Columns by object; groups and things go on counting from shot to shot."""
    d, count = answer.decision, len(answer.group)
    unreached = max(d.largest, float(d.score.max(initial=0.0)))
    threshold = np.where(np.isfinite(d.threshold), d.threshold, unreached)
    return {
        "group": np.where(answer.group > 0, answer.group + groups, 0),
        "instance": np.where(answer.thing > 0, answer.thing + things, 0),
        "score": d.score,
        "threshold": threshold,
        "yardstick": np.full(count, d.yardstick),
        "largest_cell": np.full(count, d.largest),
    }


def _displayed(labels: Artifact, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(objects,) frames in which each is seen, and its pixels at the displayed size."""
    frames, area = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for part in range(len(labels.parts)):
        table = labels.read_table(part)
        frames[table["object"]] += (table["area"] > 0).sum(0)
        area[table["object"]] += table["area"].sum(0)
    return frames, area


def each_pair(statistics: Artifact, span: Span) -> Iterator[PairGrams]:
    """The valid pairs of a shot, numbered from its start, with local ids."""
    for part, a, _ in overlapping(statistics, span.start, span.stop):
        table = statistics.read_table(part)
        keep, ids = local_ids(table["object"], span)
        for k in np.flatnonzero(table["valid"]):
            if span.start <= a + k < span.stop - 1:
                yield PairGrams(int(a + k) - span.start, ids, table["gram"][k][keep], table["cells"][k])


def read_visibility(statistics: Artifact, span: Span) -> NDArray[np.float64]:
    """(objects of the shot,) what the world's motion leaves unexplained over what the flow does."""
    total = np.zeros((len(span.objects), 2))
    for part, a, _ in overlapping(statistics, span.start, span.stop):
        table = statistics.read_table(part)
        keep, ids = local_ids(table["object"], span)
        for k, values in enumerate(table["unexplained"]):
            if span.start <= a + k < span.stop - 1:
                total[ids] += values[keep]
    return total[:, 0] / np.maximum(total[:, 1], 1e-9)


def read_pieces(statistics: Artifact, span: Span) -> Pieces:
    """Place and colour of the objects of a shot."""
    frames, count = span.stop - span.start, len(span.objects)
    area = np.zeros((frames, count), np.int32)
    box = np.full((frames, count, 4), np.nan, np.float32)
    colour: NDArray[np.int64] | None = None
    for part, a, b in overlapping(statistics, span.start, span.stop):
        table = statistics.read_table(part)
        keep, ids = local_ids(table["object"], span)
        first, last = max(a, span.start), min(b, span.stop)
        rows = slice(first - a, last - a)
        area[first - span.start : last - span.start, ids] = table["area"][rows][:, keep]
        box[first - span.start : last - span.start, ids] = table["box"][rows][:, keep]
        if colour is None:
            colour = np.zeros((count, table["colour"].shape[1]), np.int64)
        colour[ids] += table["colour"][keep]
    assert colour is not None
    return Pieces(area, box, colour)


STAGE = Stage(
    "groups",
    4,
    task,
    inputs={"affinity": ALL, "statistics": ALL, "labels": ALL, "objects": ALL},
    sections=("frames", "motion", "groups"),
    scope="video",
    cost=(1.1, 0.1),
)
