"""Stage ``features``: what is measured on the superpixels and between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.pairs import STATES
from zsmoseg.proposals.embedded.extraction import Links, measure
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.features_loops import COLUMNS, FLOW_COLUMNS
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import Memory, Part, Stage, ignored, reach
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.cues.frames import Frames
from zsmoseg.workflows.stages.embedded.segments import Segments

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Features(Arrays):
    """``SuperpixelFeatures`` of a chunk: rows of all frames or pairs one after the other, counted by frame or pair."""

    labels: ClassVar[Mapping[str, Sequence[str]]] = {
        "column": COLUMNS,
        "flow_column": FLOW_COLUMNS,
        "direction": ("forward", "backward"),
    }

    superpixels: Counts = table("frame", dtype="int64", meaning="superpixels of the frame")
    feature: NDArray[np.float32] = table(
        "superpixel", "column", dtype="float32", meaning="what a superpixel is like"
    )
    edges: Counts = table("frame", dtype="int64", meaning="edges of the frame")
    edge: NDArray[np.uint16] = table("edge_row", "end", dtype="uint16", meaning="two superpixels that touch")
    boundary: NDArray[np.int32] = table(
        "edge_row", dtype="int32", meaning="length of their boundary", unit="px"
    )
    state: NDArray[np.uint8] = table(
        "pair", dtype="uint8", meaning="0 = a pair, 1 = a cut, 2 = a repeated frame"
    )
    forward: NDArray[np.float32] = table(
        "forward_row",
        "flow_column",
        dtype="float32",
        meaning="flow of a superpixel of the first frame",
        unit="px",
    )
    superpixels_after: Counts = table("pair", dtype="int64", meaning="superpixels of the second frame")
    backward: NDArray[np.float32] = table(
        "backward_row",
        "flow_column",
        dtype="float32",
        meaning="flow of a superpixel of the second frame",
        unit="px",
    )
    links: Counts = table("pair", dtype="int64", meaning="links of the pair")
    link: NDArray[np.uint16] = table("link_row", "end", dtype="uint16", meaning="superpixel of either frame")
    carried: NDArray[np.int32] = table(
        "link_row",
        "direction",
        dtype="int32",
        meaning="pixels that the flow carries from one to the other",
        unit="px^2",
    )

    def features(self) -> SuperpixelFeatures:
        """Those of the chunks that hold these frames, cut to them."""
        names = [field.name for field in dataclasses.fields(SuperpixelFeatures)]
        found = list(self.blocks())
        chunks = [SuperpixelFeatures(**{name: getattr(block, name) for name in names}) for block in found]
        first = found[0].start
        return SuperpixelFeatures.join(chunks).part(self.start - first, self.stop - first)


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach(1)
    segments: Segments = reach(1)
    flow: Flow = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Features]:
    """The features of one chunk; the frame after it is read for the last pair only."""
    images = inputs.frames.image
    found = measure(
        images,
        inputs.segments.segment,
        inputs.flow.forward,
        inputs.flow.backward,
        [STATES[i] for i in inputs.flow.state],
        part.stop - part.start,
        ignored(s.ignore, *images.shape[1:3]),
        Links(),
    )
    yield Features(start=part.start, stop=part.stop, **found.arrays())


STAGE = Stage("features", 3, task, Inputs, Sections, Features, cost=(7.7, 154.9), memory=Memory(working=46))
