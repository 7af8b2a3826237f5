"""Stage ``statistics``: the one pass over the pixels behind every motion model, and place and colour of the objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.pieces import measure_pieces
from zsmoseg.motion.measuring import measure_pair
from zsmoseg.motion.models import MONOMIALS, SIZE
from zsmoseg.motion.photometric import grey
from zsmoseg.motion.statistics import Sums, mean_flow
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import Memory, Part, Stage, ignored, reach, working_size
from zsmoseg.workflows.stages.cues.depth import Depth
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.cues.frames import Frames
from zsmoseg.workflows.stages.front_end import Labels, shrink

Floats = NDArray[np.float64]
GRAM = ("monomial", "with_monomial")


@dataclass(frozen=True)
class Statistics(Arrays):
    """Sums over the pixels of every object of a chunk, the background first."""

    labels: ClassVar[Mapping[str, Sequence[str]]] = {
        "monomial": MONOMIALS,
        "with_monomial": MONOMIALS,
        "explanation": ("world", "flow"),
        "side": ("left", "top", "right", "bottom"),
    }

    object: NDArray[np.int64] = table("object", dtype="int64", meaning="object")
    valid: NDArray[np.bool_] = table("pair", dtype="bool", meaning="whether the two frames are a pair")
    gram: Floats = table(
        "pair", "object", *GRAM, dtype="float64", meaning="sums of products of monomials and flow", fill=0
    )
    noise: Floats = table(
        "pair", dtype="float64", meaning="variance of the flow's error on the background", unit="px^2", fill=0
    )
    velocity: NDArray[np.float32] = table(
        "pair", "object", "component", dtype="float32", meaning="mean flow, x then y", unit="px"
    )
    unexplained: Floats = table(
        "pair",
        "object",
        "explanation",
        dtype="float64",
        meaning="change of the image that the world's motion, or the flow, leaves unexplained",
        unit="grey levels^2 px",
        fill=0,
    )
    area: NDArray[np.int32] = table(
        "frame", "object", dtype="int32", meaning="pixels of the working grid", unit="px^2"
    )
    box: NDArray[np.float32] = table(
        "frame", "object", "side", dtype="float32", meaning="box around the object, end exclusive", unit="px"
    )
    colour: NDArray[np.int64] = table(
        "object", "bin", dtype="int64", meaning="histogram of L, a, b over the chunk", unit="px^2", add=True
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach(1)
    flow: Flow = reach()
    depth: Depth = reach()
    labels: Labels = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    statistics: settings.Statistics
    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Statistics]:
    """The statistics of one chunk."""
    grid = working_size(part.probe, s.frames.width)
    labels, images, mask = shrink(inputs.labels.label, *grid), inputs.frames.image, ignored(s.ignore, *grid)
    ids = np.union1d([0], np.flatnonzero(np.bincount(labels.ravel()))).astype(np.int64)
    sums, pairs, valid = s.statistics.parameters(Sums), part.last_pair - part.start, inputs.flow.valid
    gram = np.zeros((pairs, len(ids), SIZE, SIZE))
    noise, velocity = np.zeros(pairs), np.full((pairs, len(ids), 2), np.nan, np.float32)
    unexplained = np.zeros((pairs, len(ids), 2))
    forward, backward, depth = inputs.flow.forward, inputs.flow.backward, inputs.depth.inverse_depth
    looks = [grey(image) for image in images]
    for m in np.flatnonzero(valid):
        known, both = None if depth is None else depth[m], (looks[m], looks[m + 1])
        found = measure_pair(labels[m], ids, forward[m], backward[m], known, both, mask, sums)
        gram[m], noise[m], unexplained[m] = found.gram, found.noise, found.unexplained
        velocity[m] = mean_flow(found.gram)
    pieces = measure_pieces(labels, images[: part.stop - part.start], ids)
    yield Statistics(
        start=part.start,
        stop=part.stop,
        object=ids,
        valid=valid,
        gram=gram,
        noise=noise,
        velocity=velocity,
        unexplained=unexplained,
        area=pieces.area,
        box=pieces.box,
        colour=pieces.colour,
    )


STAGE = Stage(
    "statistics", 6, task, Inputs, Sections, Statistics, cost=(3.9, 18.0), memory=Memory(working=40)
)
