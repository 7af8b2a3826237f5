"""Stage ``residuals``: how well the model of each object explains each other, pair by pair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import MODELS
from zsmoseg.motion.residuals import pair_residuals
from zsmoseg.workflows.reading import overlapping
from zsmoseg.workflows.stage import Left, Stage, Task


def task(task: Task) -> Left:
    """A group a chunk of statistics: ``residual`` (pair, model slot, slot) px^2, ``pixels``, ``coefficient``."""
    return Left(groups=_groups(task))


def _groups(task: Task) -> Iterator[tuple[str, Mapping[str, NDArray[Any]]]]:
    statistics, model = task.inputs["statistics"], MODELS[task.settings.motion.model]
    for part, a, _ in overlapping(statistics, task.start, task.stop):
        table = statistics.read_table(part)
        inside = slice(max(task.start - a, 0), task.stop - a)
        count = len(table["object"])
        found = [pair_residuals(gram, model) for gram in table["gram"][inside]]
        shapes = (count, count), (count,), (count, model.parameters)
        stacks = [np.stack([np.zeros(shape), *(f[i] for f in found)])[1:] for i, shape in enumerate(shapes)]
        yield (
            f"{max(task.start, a):08d}",
            {
                "object": table["object"],
                "valid": table["valid"][inside],
                **dict(zip(("residual", "pixels", "coefficient"), stacks, strict=True)),
            },
        )


STAGE = Stage("residuals", 1, task, inputs={"statistics": 0}, sections=("motion",), cost=(0.3, 0.3))
