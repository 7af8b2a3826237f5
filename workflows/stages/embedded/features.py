"""Stage ``features``: what is measured on the superpixels and between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.pairs import STATES
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.tables import ChunkTables, chunk_tables
from zsmoseg.workflows.stage import Part, Stage, ignored, reach
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.cues.frames import Frames
from zsmoseg.workflows.stages.embedded.segments import Segments

NODE = ("size", "y", "x", "L", "a", "b", "rim", "detail", "xx", "xy", "yy")
SIDE = ("u", "v", "error", "change")


def _rows(dim: str, dtype: str, meaning: str, *more: str) -> Any:
    return table(dim, *more, dtype=dtype, meaning=meaning)


@dataclass(frozen=True)
class Features(Arrays):
    """The measurements of a chunk; rows of all frames or pairs one after the other, counted by frame or pair."""

    labels: ClassVar[Mapping[str, Sequence[str]]] = {
        "feature": NODE,
        "measure": SIDE,
        "direction": ("forward", "backward"),
    }

    nodes: NDArray[np.int64] = table("frame", dtype="int64", meaning="number of superpixels")
    node: NDArray[np.float32] = _rows("superpixel", "float32", "what a superpixel is like", "feature")
    edges: NDArray[np.int64] = table("frame", dtype="int64", meaning="number of edges")
    edge: NDArray[np.uint16] = _rows("edge_row", "uint16", "two superpixels that touch", "end")
    boundary: NDArray[np.int32] = _rows("edge_row", "int32", "length of their boundary")
    state: NDArray[np.uint8] = table(
        "pair", dtype="uint8", meaning="0 = a pair, 1 = a cut, 2 = a repeated frame"
    )
    forth: NDArray[np.float32] = _rows(
        "forth_row", "float32", "of a superpixel of the first frame", "measure"
    )
    backs: NDArray[np.int64] = table(
        "pair", dtype="int64", meaning="number of superpixels of the second frame"
    )
    back: NDArray[np.float32] = _rows("back_row", "float32", "of a superpixel of the second frame", "measure")
    links: NDArray[np.int64] = table("pair", dtype="int64", meaning="number of links")
    link: NDArray[np.uint16] = _rows("link_row", "uint16", "superpixels of both frames", "end")
    carried: NDArray[np.int32] = _rows("link_row", "int32", "pixels carried", "direction")

    def tables(self) -> ChunkTables:
        """Those of the chunks that hold these frames, cut to them."""
        chunks, first = [], None
        for block in self.blocks():
            first = block.start if first is None else first
            chunks.append(block.chunk())
        assert first is not None
        return ChunkTables.join(chunks).part(self.start - first, self.stop - first)

    def chunk(self) -> ChunkTables:
        def off(c: NDArray[np.int64]) -> NDArray[np.int64]:
            return np.cumsum([0, *c], dtype=np.int64)

        return ChunkTables(
            off(self.nodes),
            self.node,
            off(self.edges),
            self.edge,
            self.boundary,
            self.state,
            self.forth,
            off(self.backs),
            self.back,
            off(self.links),
            self.link,
            self.carried,
        )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach(1)
    segments: Segments = reach(1)
    flow: Flow = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    tables: settings.Tables
    ignore: settings.Ignore


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Features]:
    """The features of one chunk; the frame after it is read for the last pair only."""
    images = inputs.frames.image
    t = chunk_tables(
        images,
        inputs.segments.segment,
        inputs.flow.forward,
        inputs.flow.backward,
        [STATES[i] for i in inputs.flow.state],
        part.stop - part.start,
        ignored(s.ignore, *images.shape[1:3]),
        s.tables,
    )
    d = np.diff
    yield Features(
        start=part.start,
        stop=part.stop,
        nodes=d(t.node_offset),
        node=t.node,
        edges=d(t.edge_offset),
        edge=t.edge,
        boundary=t.boundary,
        state=t.state,
        forth=t.forth,
        backs=d(t.back_offset),
        back=t.back,
        links=d(t.link_offset),
        link=t.link,
        carried=t.carried,
    )


STAGE = Stage("features", 2, task, Inputs, Sections, Features, cost=(7.7, 154.9))
