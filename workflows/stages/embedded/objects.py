"""Stage ``objects``: which superpixels are foreground and which object each belongs to, shot by shot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.errors import SettingsError
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.objects import LENGTH, MARGIN, FrameObjects, find_objects
from zsmoseg.proposals.embedded.objects import Objects as Parameters
from zsmoseg.stores.fields import table
from zsmoseg.tracking.spans import MOST
from zsmoseg.workflows.stage import ALL, Memory, Part, Stage, reach, working_size
from zsmoseg.workflows.stages.cues.flow import Flow, between_cuts
from zsmoseg.workflows.stages.embedded.features import Features
from zsmoseg.workflows.stages.front_end import Objects, shot_columns

BLOCK = 16
"""Frames that are written at once."""


@dataclass(frozen=True)
class SuperpixelObjects(Objects):
    """The objects as superpixels, those of all frames one after the other."""

    score: NDArray[np.float32] = table(
        "frame", dtype="float32", meaning="0: nothing moves by itself, to 1: something surely does"
    )
    superpixels: NDArray[np.int64] = table("frame", dtype="int64", meaning="number of superpixels")
    value: NDArray[np.float32] = table("superpixel", dtype="float32", meaning="log-odds of being foreground")
    object_of: NDArray[np.int32] = table("superpixel", dtype="int32", meaning="object, 0 = none")
    look: NDArray[np.uint8] = table(
        "superpixel",
        dtype="uint8",
        meaning="the look that found it, each at what those before left; 0 = none",
    )
    sure: NDArray[np.float32] = table(
        "superpixel", dtype="float32", meaning="mean score over the life of its object, in that look"
    )


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    features: Features = reach(ALL)
    flow: Flow = reach(ALL)


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    frames: settings.Frames
    objects: settings.Objects


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[SuperpixelObjects]:
    """All shots of the video, one after the other; ids go on counting from shot to shot."""
    found, last = between_cuts(inputs.flow.state), [0]
    whole = np.zeros(1, np.int64)
    waiting: list[FrameObjects] = []
    frame = 0

    def load(start: int, stop: int) -> SuperpixelFeatures:
        return inputs.features.of(start, stop).features()

    grid, parameters = working_size(part.probe, s.frames.width), s.objects.parameters(Parameters)
    for shot in found:
        highest, together = last[-1], Counter[tuple[int, int]]()
        for one in find_objects(load, shot, grid, parameters):
            ids = np.where(one.ids > 0, one.ids + last[-1], 0).astype(np.int32)
            highest = max(highest, int(ids.max(initial=0)))
            mine = ids > 0
            together.update(zip(ids[mine].tolist(), one.whole[mine].tolist(), strict=True))
            waiting.append(one._replace(ids=ids))
            frame += 1
            if frame % BLOCK == 0 or frame == part.frames:
                yield _block(frame, waiting)
                waiting = []
        if highest > MOST:
            raise SettingsError(
                f"more than {MOST} objects up to frame {shot[1] - 1}, more than a label image holds; run the video in pieces "
                "(video.start, video.end)"
            )
        whole = np.append(whole, wholes_of(together, last[-1] + 1, highest))
        last.append(highest)
    yield SuperpixelObjects(**shot_columns(part.frames, found, last[1:], whole))


def wholes_of(together: Mapping[tuple[int, int], int], first: int, last: int) -> NDArray[np.int64]:
    """Of each of the objects ``first`` to ``last`` the largest that is most in the same whole.

    Parameters
    ----------
    together
        Superpixels by object and number of the whole.
    """
    head: dict[int, int] = {}
    whole: dict[int, int] = {}
    for n, number in sorted(together, key=lambda both: (-together[both], both)):
        if n not in whole:  # else it is more in another
            whole[n] = head.setdefault(number, n)
    return np.array([whole.get(n, n) for n in range(first, last + 1)], np.int64)


def _block(stop: int, found: list[FrameObjects]) -> SuperpixelObjects:
    """The frames up to ``stop``."""
    values, ids, _, looks, sure, scores = zip(*found, strict=True)
    return SuperpixelObjects(
        start=stop - len(found),
        stop=stop,
        score=np.array(scores, np.float32),
        superpixels=np.array([len(value) for value in values], np.int64),
        value=np.concatenate(values),
        object_of=np.concatenate(ids),
        look=np.concatenate(looks).astype(np.uint8),
        sure=np.concatenate(sure),
    )


def each_frame(objects: SuperpixelObjects, start: int, stop: int) -> Iterator[NDArray[np.int32]]:
    """Object of the superpixels of the frames ``start`` to ``stop - 1``."""
    for block in objects.of(start, stop).blocks():
        if not block.has("object_of"):
            continue
        ends = np.cumsum([0, *block.superpixels])
        for k in range(max(start - block.start, 0), min(stop, block.stop) - block.start):
            yield block.object_of[ends[k] : ends[k + 1]]


def _held(s: Sections) -> int:
    """Frames of a window with its margins."""
    return LENGTH + 2 * (s.objects.window + MARGIN)


STAGE = Stage(
    "objects",
    8,
    task,
    Inputs,
    Sections,
    SuperpixelObjects,
    "video",
    cost=(14.2, 6.2),
    memory=Memory(working=27, frames=_held),
)
