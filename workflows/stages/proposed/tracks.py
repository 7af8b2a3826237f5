"""Stage ``tracks``: the masks of each span's first frame followed through it, and handed over to the next span."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.errors import NetworkError
from zsmoseg.formats.rle import mask_of, packed, unpacked
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.tracking.by_flow import FlowTracker
from zsmoseg.tracking.by_network import network_tracker
from zsmoseg.tracking.carrying import Label
from zsmoseg.tracking.protocol import Factory, Step
from zsmoseg.tracking.spans import Begun, Followed, Follower, Halt, Moment, Spans
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts
from zsmoseg.workflows.stages.proposed.looks import span_of
from zsmoseg.workflows.stages.proposed.proposals import Proposals

Ids = NDArray[np.int64]
NONE = np.zeros(0, np.int64)
BLOCK = 16
"""Frames that are written at once."""
WINDOW = 160
"""Frames of a part at least: what a kill loses at most. The next one tracks the frames of a span or two again."""


@dataclass(frozen=True)
class Tracks(Arrays):
    """The objects of every frame, one behind the other, and which of them each proposed mask became.

    Behind the frames of a window stands what the next one goes on from.
    """

    tracked: Ids = table("frame", dtype="int64", meaning="how many objects are seen in it")
    object_of: Ids = table("mask_of_frame", dtype="int64", meaning="the object, frame by frame")
    length: Ids = table("mask_of_frame", dtype="int64", meaning="bytes of its mask in run")
    run: NDArray[np.uint8] = table(
        "byte", dtype="uint8", meaning="masks as COCO's run lengths, displayed size"
    )
    became: Ids = table("proposal", dtype="int64", meaning="object of each proposed mask, in their order")
    largest: Ids = table("shot", dtype="int64", meaning="largest object up to the end of the shot")
    last_object: Ids = table("window", dtype="int64", meaning="largest object up to the end of a window")
    goes_on: Ids = table(
        "number", dtype="int64", meaning="object of each number of the tracker at work there, 0 = ended"
    )
    missed: Ids = table("number", dtype="int64", meaning="looks in a row without a mask of it")
    given: Ids = table("time_given", dtype="int64", meaning="frame in which that tracker was given masks")
    given_length: Ids = table("mask_given", dtype="int64", meaning="bytes of each mask in given_run")
    given_run: NDArray[np.uint8] = table("byte_given", dtype="uint8", meaning="these masks, as in run")


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    proposals: Proposals = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    looks: settings.Looks
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
    """A shot from its first frame, ``start``, and the frame that the trackers are at."""

    start: int
    at: int = 0


def _moments(part: Part, inputs: Inputs, shot: _Shot, first: int, stop: int) -> Iterator[Moment]:
    """Frames ``first`` to ``stop - 1`` of a shot, with the masks that are proposed; one frame in memory at a time."""
    known = inputs.proposals.known
    for t, frame in enumerate(part.images(first, stop), start=first):
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
    """A window, shot by shot: a span needs what the one before it handed over, a window what the one before it left."""
    spans = Spans(s.tracking.handover, s.linking.overlap, s.linking.gap, s.tracking.carry)
    factory = _factory(part, s)
    halt = Halt(0, None, NONE, NONE) if part.before is None else _halt(part.before, part.displayed)
    for start, stop in between_cuts(inputs.flow.state):
        first, end = max(start, part.start), min(stop, part.stop)
        if first >= end:
            continue
        shot, follower = _Shot(start), Follower(factory, spans, halt.last, first)
        with _naming(part, shot):
            if first > start and halt.begun is not None:
                follower.resume(halt, _moments(part, inputs, shot, halt.begun.frame, first))
        followed = follower.run(_moments(part, inputs, shot, first, end), goes_on=end < stop)
        for at in range(first, end, BLOCK):
            with _naming(part, shot):
                found = list(islice(followed, min(BLOCK, end - at)))
            yield _block(at, found, follower.last if end == stop and at + BLOCK >= end else None)
        halt = follower.halt() if end < stop else Halt(follower.last, None, NONE, NONE)
    yield _left(part, halt)


@contextmanager
def _naming(part: Part, shot: _Shot) -> Iterator[None]:
    """What fails names the frame that the trackers are at."""
    try:
        yield
    except NetworkError:
        with part.at_frame(shot.at):
            raise


def _block(start: int, found: list[Followed], last: int | None) -> Tracks:
    """Some frames; ``last`` is the largest object of the shot that ends with them."""
    present = [np.unique(f.label[f.label > 0]).astype(np.int64) for f in found]
    length, run = packed(f.label == n for f, numbers in zip(found, present, strict=True) for n in numbers)
    became = [f.masks for f in found if f.masks is not None]
    return Tracks(
        start=start,
        stop=start + len(found),
        tracked=np.array([len(n) for n in present], np.int64),
        object_of=np.concatenate([NONE, *present]),
        length=length,
        run=run,
        became=np.concatenate([NONE, *became]),
        largest=NONE if last is None else np.array([last], np.int64),
    )


def _left(part: Part, halt: Halt) -> Tracks:
    """What the next window goes on from."""
    given = _given(halt.begun)
    numbers = range(1, len(halt.objects))
    length, run = packed(label == n for _, label in given for n in numbers)
    return Tracks(
        start=part.start,
        stop=part.stop,
        last_object=np.array([halt.last], np.int64),
        goes_on=halt.objects,
        missed=halt.missed,
        given=np.array([frame for frame, _ in given], np.int64),
        given_length=length,
        given_run=run,
    )


def _given(begun: Begun | None) -> list[tuple[int, Label]]:
    """The frames in which a tracker was given masks, and the masks."""
    if begun is None:
        return []
    return [(begun.frame, begun.label), *([begun.late] if begun.late is not None else [])]


def _halt(before: Tracks, size: tuple[int, int]) -> Halt:
    """What the window before has left."""
    numbers, masks = len(before.goes_on) - 1, unpacked(before.given_length, before.given_run, size)
    given: list[tuple[int, Label]] = []
    for k, frame in enumerate(before.given.tolist()):
        label = np.zeros(size, np.uint16)
        for n, rle in enumerate(masks[k * numbers : (k + 1) * numbers], start=1):
            label[mask_of(rle)] = n
        given.append((frame, label))
    begun = Begun(*given[0], *given[1:]) if given else None
    return Halt(int(before.last_object[0]), begun, before.goes_on, before.missed)


STAGE = Stage(
    "tracks",
    2,
    task,
    Inputs,
    Sections,
    Tracks,
    span=span_of,
    least=WINDOW,
    follows=True,
    cost=(60.0, 3.0),
    memory=Memory(shown=100, frames=lambda s: 1),
)
