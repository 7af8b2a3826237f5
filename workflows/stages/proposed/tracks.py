"""Stage ``tracks``: the masks of each span's first frame followed through it, and handed over to the next span."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.errors import NetworkError
from zsmoseg.formats.rle import packed
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.tracking.by_flow import FlowTracker
from zsmoseg.tracking.by_network import network_tracker
from zsmoseg.tracking.protocol import Factory, Step
from zsmoseg.tracking.spans import Followed, Moment, Spans, follow
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts
from zsmoseg.workflows.stages.proposed.proposals import Proposals

Ids = NDArray[np.int64]
BLOCK = 16
"""Frames that are written at once."""


@dataclass(frozen=True)
class Tracks(Arrays):
    """The objects of every frame, one behind the other, and which of them each proposed mask became."""

    tracked: Ids = table("frame", dtype="int64", meaning="how many objects are seen in it")
    object_of: Ids = table("mask_of_frame", dtype="int64", meaning="the object, frame by frame")
    length: Ids = table("mask_of_frame", dtype="int64", meaning="bytes of its mask in run")
    run: NDArray[np.uint8] = table(
        "byte", dtype="uint8", meaning="masks as COCO's run lengths, displayed size"
    )
    became: Ids = table("proposal", dtype="int64", meaning="object of each proposed mask, in their order")
    largest: Ids = table("shot", dtype="int64", meaning="largest object up to the end of the shot")


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    proposals: Proposals = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    linking: settings.Linking
    tracking: settings.Tracking


def _factory(part: Part, s: Sections) -> Factory:
    """A tracker a span."""
    if s.tracking.source == "network":
        return network_tracker(part.network(s.tracking.model))
    grid = working_size(part.probe, s.frames.width)
    return lambda: FlowTracker(grid)


@dataclass
class _Shot:
    """The frames ``start`` to ``stop - 1``, and the one that the trackers are at."""

    start: int
    stop: int
    at: int = 0


def _moments(part: Part, inputs: Inputs, shot: _Shot) -> Iterator[Moment]:
    """The frames of one shot, with the masks that are proposed; one frame in memory at a time."""
    known = inputs.proposals.known
    for t, frame in enumerate(part.images(shot.start, shot.stop), start=shot.start):
        shot.at = t
        backward = forward = None
        if t > shot.start:
            pair = inputs.flow.of(t - 1, t)
            backward, forward = pair.backward[0], pair.forward[0]
        masks = None
        if known[t]:
            label = inputs.proposals.of(t, t + 1).mask[0]
            numbers = np.unique(label[label > 0])
            # 1 to K without gaps: what lies wholly under others has no pixels
            masks = np.append(0, np.searchsorted(numbers, np.arange(1, int(label.max()) + 1)) + 1)[label]
            masks = masks.astype(np.uint16)
        yield Moment(Step(frame, backward, forward), masks)


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Tracks]:
    """The whole video, shot by shot: a span needs what the one before it handed over."""
    spans = Spans(s.tracking.handover, s.linking.overlap, s.linking.gap, s.tracking.carry)
    factory, last = _factory(part, s), 0
    for start, stop in between_cuts(inputs.flow.state):
        shot = _Shot(start, stop)
        followed = follow(_moments(part, inputs, shot), factory, spans, last)
        for at in range(start, stop, BLOCK):
            try:
                found = list(islice(followed, min(BLOCK, stop - at)))
            except NetworkError:
                with part.at_frame(shot.at):
                    raise
            last = max([last, *(int(f.masks.max(initial=0)) for f in found if f.masks is not None)])
            yield _block(at, found, last if at + BLOCK >= stop else None)


def _block(start: int, found: list[Followed], last: int | None) -> Tracks:
    """Some frames; ``last`` is the largest object of the shot that ends with them."""
    present = [np.unique(f.label[f.label > 0]).astype(np.int64) for f in found]
    length, run = packed(f.label == n for f, numbers in zip(found, present, strict=True) for n in numbers)
    became = [f.masks for f in found if f.masks is not None]
    none = np.zeros(0, np.int64)
    return Tracks(
        start=start,
        stop=start + len(found),
        tracked=np.array([len(n) for n in present], np.int64),
        object_of=np.concatenate([none, *present]),
        length=length,
        run=run,
        became=np.concatenate([none, *became]),
        largest=none if last is None else np.array([last], np.int64),
    )


STAGE = Stage(
    "tracks",
    1,
    task,
    Inputs,
    Sections,
    Tracks,
    "video",
    cost=(60.0, 3.0),
    memory=Memory(shown=100, frames=lambda s: 1),
)
