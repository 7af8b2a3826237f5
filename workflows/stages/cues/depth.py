"""Stage ``depth``: relative inverse depth of every frame; nothing where it is constant."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.depth.ground import ground
from zsmoseg.networks.depth import network_depth
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import video
from zsmoseg.workflows.imports.contents import count_unknown, depth_of, passed_over
from zsmoseg.workflows.stage import Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.frames import Frames


@dataclass(frozen=True)
class Depth(Arrays):
    """Pseudo depth."""

    inverse_depth: NDArray[np.float16] | None = video(
        "frame", "y", "x", dtype="float16", meaning="relative inverse depth, near is large"
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    frames: Frames = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    depth: settings.Depth


LARGEST = float(np.finfo(np.float16).max)
"""Of what is written: as many times nearer than the mean as anything is."""

Backend = Callable[[Part, Sections], Iterator[NDArray[np.float32]]]
"""Yields relative inverse depth (h, w) of every frame of the part."""


def _ground(part: Part, s: Sections) -> Iterator[NDArray[np.float32]]:
    plane = ground(*working_size(part.probe, s.frames.width))
    return (plane for _ in range(part.start, part.stop))


def _imported(part: Part, s: Sections) -> Iterator[NDArray[np.float32]]:
    grid = working_size(part.probe, s.frames.width)
    part.facts.update(passed_over("depth", s.depth, part.probe) if not part.start else {})
    for inverse in depth_of(s.depth, part.probe, part.start, part.stop, grid):
        count_unknown(part.facts, inverse)
        yield inverse


def _network(part: Part, s: Sections) -> Iterator[NDArray[np.float32]]:
    frames = part.images(part.start, part.stop)
    found = network_depth(
        part.network(s.depth.model), frames, working_size(part.probe, s.frames.width), part.batch
    )
    for t in range(part.start, part.stop):
        with part.at_frame(t):
            yield next(found)


BACKENDS: dict[str, Backend] = {"ground": _ground, "network": _network, "imported": _imported}
"""By the setting ``depth.source``; ``constant`` leaves nothing."""


def _constant(s: Sections) -> bool:
    return s.depth.source == "constant"


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Depth]:
    """Depth of one chunk."""
    if not _constant(s):
        found = np.stack(list(BACKENDS[s.depth.source](part, s)))
        depth = found.clip(-LARGEST, LARGEST).astype(np.float16)
        yield Depth(start=part.start, stop=part.stop, inverse_depth=depth)


STAGE = Stage("depth", 2, task, Inputs, Sections, Depth, nothing=_constant, memory=Memory(working=8))
