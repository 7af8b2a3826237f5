"""Stage ``flow``: optical flow of every pair in both directions, and which pairs are cuts or repeats."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.flow.dis import Dis, between
from zsmoseg.flow.pairs import CUT, STATES, PairCriteria, pair_state
from zsmoseg.flow.warp import resized
from zsmoseg.networks.flow import network_flow
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table, video
from zsmoseg.workflows.imports.contents import count_unknown, flow_of, passed_over
from zsmoseg.workflows.stage import Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.frames import Frames

Vectors = NDArray[np.float32]
READ = 4
"""Pairs that are read at once where one after the other is looked at."""
UNKNOWN = -32768
"""What is stored where flow is unknown: the lowest number, so that all others are left for flow."""


def _vectors(meaning: str) -> Vectors:
    """(pair, 2, h, w), stored in 64ths of a pixel: half of that is less than what flow errs by, and 500 px fit."""
    dims = ("pair", "component", "y", "x")
    stored: Vectors = video(
        *dims, dtype="int16", meaning=meaning, unit="px", fill=UNKNOWN, scale=1 / 64, codec="flow"
    )
    return stored


@dataclass(frozen=True)
class Flow(Arrays):
    """Optical flow, px of the working grid; a pair belongs to its first frame."""

    forward: Vectors = _vectors("flow from the first frame to the second, x then y")
    backward: Vectors = _vectors("flow from the second frame to the first, x then y")
    state: NDArray[np.uint8] = table(
        "pair", dtype="uint8", meaning="0 = a pair, 1 = a cut, 2 = a repeated frame"
    )
    valid: NDArray[np.bool_] = table("pair", dtype="bool", meaning="whether the two frames are a pair")

    def each_pair(self, start: int, stop: int) -> Iterator[tuple[Vectors, Vectors]]:
        """Flow (2, h, w) forward and backward of the pairs ``start`` to ``stop - 1``, ``READ`` of them in memory at a time."""
        for first in range(start, stop, READ):
            some = self.of(first, min(first + READ, stop))
            yield from zip(some.forward, some.backward, strict=True)


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach(1)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    flow: settings.Flow


Backend = Callable[[Part, Inputs, Sections], Iterator[tuple[Vectors, Vectors]]]
"""Yields flow forward and backward (2, h, w), px of the working grid, of every pair of the part."""


def _dis(part: Part, inputs: Inputs, s: Sections) -> Iterator[tuple[Vectors, Vectors]]:
    parameters = s.flow.parameters(Dis)
    return (between(a, b, parameters) for a, b in pairwise(inputs.frames.image))


def _imported(part: Part, inputs: Inputs, s: Sections) -> Iterator[tuple[Vectors, Vectors]]:
    grid = working_size(part.probe, s.frames.width)
    part.facts.update(passed_over("flow", s.flow, part.probe) if not part.start else {})
    for there, back in flow_of(s.flow, part.probe, part.start, part.last_pair, grid):
        count_unknown(part.facts, there[0])
        yield there, back


def _network(part: Part, inputs: Inputs, s: Sections) -> Iterator[tuple[Vectors, Vectors]]:
    network, grid = part.network(s.flow.model), working_size(part.probe, s.frames.width)
    frames = part.images(part.start, part.last_pair + 1)
    for t, (a, b) in enumerate(pairwise(frames), start=part.start):
        with part.at_frame(t):
            yield resized(network_flow(network, a, b), grid), resized(network_flow(network, b, a), grid)


BACKENDS: dict[str, Backend] = {"dis": _dis, "network": _network, "imported": _imported}
"""By the setting ``flow.source``."""


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Flow]:
    """Flow of the pairs that start in one chunk."""
    images = inputs.frames.image
    forward, backward = (
        np.zeros((part.last_pair - part.start, 2, *images.shape[1:3]), np.float32) for _ in range(2)
    )
    state = np.zeros(len(forward), np.uint8)
    pairs = zip(pairwise(images), BACKENDS[s.flow.source](part, inputs, s), strict=True)
    criteria = s.flow.parameters(PairCriteria)
    for k, ((a, b), vectors) in enumerate(pairs):
        forward[k], backward[k] = vectors
        state[k] = STATES.index(pair_state(a, b, *vectors, criteria))
    yield Flow(
        start=part.start, stop=part.stop, forward=forward, backward=backward, state=state, valid=state == 0
    )


def between_cuts(state: NDArray[np.uint8]) -> list[tuple[int, int]]:
    """The shots, (start, stop) in frames, by the ``state`` of all pairs."""
    cuts = (np.flatnonzero(state == CUT) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, len(state) + 1], strict=True))


STAGE = Stage("flow", 3, task, Inputs, Sections, Flow, cost=(23.9, 328.4), memory=Memory(working=42))
