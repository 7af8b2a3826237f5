"""Stage ``residuals``: how well the motion of each object explains each other, and what one for two costs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.motion.models import MODELS
from zsmoseg.motion.residuals import residuals_of_pairs
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import Part, Stage, reach
from zsmoseg.workflows.stages.motion.statistics import Statistics

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Residuals(Arrays):
    """What the motions of a chunk's objects leave on their own pixels, on each other's, and together."""

    object: NDArray[np.int64] = table("object", dtype="int64", meaning="object")
    valid: NDArray[np.bool_] = table("pair", dtype="bool", meaning="whether the two frames are a pair")
    pixels: Floats = table(
        "pair", "object", dtype="float64", meaning="pixels that count", unit="px^2", fill=0
    )
    own: Floats = table(
        "pair", "object", dtype="float64", meaning="mean square that its own motion leaves", unit="px^2"
    )
    merge: Floats = table(
        "pair",
        "object",
        "other",
        dtype="float64",
        meaning="what one motion for two costs over two motions, a pixel of the smaller",
        unit="px^2",
    )
    residual: Floats = table(
        "pair",
        "model",
        "object",
        dtype="float64",
        meaning="mean squared residual of the model of one object on the pixels of another",
        unit="px^2",
    )
    coefficient: Floats = table(
        "pair", "object", "term", dtype="float64", meaning="parameters of the motion model"
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    statistics: Statistics = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    motion: settings.Motion


def terms(s: Sections) -> Mapping[str, Sequence[str]]:
    """The names of the parameters."""
    return {"term": MODELS[s.motion.model].terms}


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Residuals]:
    """The residuals of one chunk: a block for each chunk of statistics, over the objects of that."""
    model = MODELS[s.motion.model]
    for block in inputs.statistics.blocks():
        inside = slice(max(part.start - block.start, 0), part.stop - block.start)
        found = residuals_of_pairs(block.gram[inside], model)
        yield Residuals(
            start=max(part.start, block.start),
            stop=min(part.stop, block.stop),
            object=block.object,
            valid=block.valid[inside],
            pixels=found.pixels,
            own=found.own,
            merge=found.merge,
            residual=found.residual,
            coefficient=found.coefficient,
        )


STAGE = Stage("residuals", 3, task, Inputs, Sections, Residuals, labels=terms, cost=(0.3, 0.3))
