"""What a source holds: which frames are used, when they are shown and how they are called."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from zsmoseg.errors import VideoError
from zsmoseg.video import places
from zsmoseg.video.decoding import Way
from zsmoseg.video.index import index
from zsmoseg.video.pixels import BITS, image_size, value_bits
from zsmoseg.video.sources import image_files

EARLY = 1e-9
"""Seconds that a frame may be shown before the time asked for: the error of times in binary fractions."""


@dataclass(frozen=True)
class Excerpt:
    """Which frames of a source are used."""

    start: str
    """First frame: seconds (``12.5``, ``1:02:03.5``) or a number (``300f``); empty: the first there is."""
    end: str
    """End, exclusive, as ``start``; empty: the last there is."""
    every: int
    """Frames from one that is used to the next."""
    fps: float
    """1/s, of folders of images, which carry no times."""
    allow_truncated: bool
    """Whether the part of a damaged file that can be decoded is good enough."""


@dataclass(frozen=True)
class Probe:
    """The used frames of a source, in order."""

    source: str
    files: tuple[str, ...]
    """One a frame for images; empty for a video file."""
    pts: tuple[int, ...]
    """Presentation times as ``way`` takes them; empty for images."""
    way: Way
    """How the frames of a video file are found."""
    names: tuple[str, ...]
    """Of the files written for each frame."""
    times: tuple[float, ...]
    """Seconds from the start of the source."""
    width: int
    height: int
    """As displayed: rotation applied; the shape of pixels is not."""
    indices: tuple[int, ...] = ()
    """Of the used frames among all frames of the source."""
    total: int = 0
    """Frames of the source, used or not."""
    bits: int = 16
    """That count of the values of images with 16."""
    notes: tuple[str, ...] = ()
    """What its user should know of it."""

    def to_json(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Probe:
        """From JSON."""
        return cls(**{**_tuples(content), "way": Way(**_tuples(content["way"]))})


def _tuples(content: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}


def probe(source: str, excerpt: Excerpt) -> Probe:
    """Look at a source without decoding it all.

    Parameters
    ----------
    source : a video file, a folder of images, or a glob of images.
    excerpt : which of its frames are used.

    Returns
    -------
    Its used frames, with absolute paths: workers may stand in another folder.

    Raises
    ------
    VideoError
        Not a video; fewer than two frames; images of different sizes; damaged (unless ``excerpt.allow_truncated``);
        ``start``, ``end`` and ``every`` leave fewer than two frames.
    """
    files = image_files(source)
    if files:
        return _probe_images(source, files, excerpt)
    if places.is_folder(source):
        raise VideoError(f"{source}: holds no frames; give a folder of images (jpg, png, tif, bmp, webp)")
    if not places.is_file(source):
        raise places.nothing_there(source)
    return _probe_file(source, excerpt)


def _probe_images(source: str, files: list[str], excerpt: Excerpt) -> Probe:
    used = _used([i / excerpt.fps for i in range(len(files))], source, excerpt)
    chosen = [places.absolute(files[i]) for i in used]
    sizes = [image_size(f) for f in chosen]
    for file, size in zip(chosen, sizes, strict=True):
        if size != sizes[0]:
            raise VideoError(
                f"{file}: is {size[0]} x {size[1]}, {os.path.basename(chosen[0])} is {sizes[0][0]} x {sizes[0][1]}; "
                "all frames of a folder must have one size"
            )
    _refuse_twins(chosen)
    bits, largest = value_bits(chosen)
    said = f"its images of 16 bits hold values up to {largest}: taken as {bits} bits"
    return Probe(
        places.absolute(source),
        tuple(chosen),
        (),
        Way(),
        tuple(Path(f).stem for f in chosen),
        tuple(i / excerpt.fps for i in used),
        *sizes[0],
        indices=tuple(used),
        total=len(files),
        bits=bits,
        notes=(said,) if bits < BITS[-1] else (),
    )


def _refuse_twins(files: Sequence[str]) -> None:
    """Raise where one frame seems to be there twice: as another kind of file, or as two kinds of names that count alike."""
    seen: dict[str, str] = {}
    counted: dict[str, dict[tuple[str, ...], str]] = defaultdict(dict)
    for path in files:
        stem = unicodedata.normalize("NFC", Path(path).stem)
        if stem in seen:
            raise _twice(seen[stem], path)
        seen[stem] = path
        counted[re.sub(r"\d+", "#", stem)][tuple(re.findall(r"\d+", stem))] = path
    for one, other in combinations((names for names in counted.values() if len(names) > 1), 2):
        both = [number for number in one if number in other]
        if len(both) > 1:
            raise _twice(one[both[0]], other[both[0]])


def _twice(one: str, other: str) -> VideoError:
    names = os.path.basename(one), os.path.basename(other)
    return VideoError(
        f"{one}: {names[0]} and {names[1]} seem to be one frame, or a frame and its mask; take one kind of them out, or "
        "give a glob of the frames in quotes"
    )


def _probe_file(source: str, excerpt: Excerpt) -> Probe:
    found = index(source, thorough=excerpt.allow_truncated)
    if not found.whole and not excerpt.allow_truncated:
        raise VideoError(
            f"{source}: is damaged or cut off: frames 0 to {found.decodable - 1} can be decoded, "
            f"frame {found.decodable} cannot; --allow-truncated goes on with those"
        )
    pts, times = found.pts[: found.decodable], found.seconds[: found.decodable]
    used = _used(times, source, excerpt)
    return Probe(
        places.absolute(source),
        (),
        tuple(pts[i] for i in used),
        found.way,
        tuple(f"{i:05d}" for i in used),
        tuple(times[i] for i in used),
        found.width,
        found.height,
        indices=tuple(used),
        total=len(times),
        notes=found.notes,
    )


def _used(times: Sequence[float], source: str, excerpt: Excerpt) -> range:
    """The frames between start and end, every n-th."""
    if len(times) < 2:
        raise VideoError(f"{source}: has {len(times)} frame; motion needs two at least")
    length = f"its {len(times)} frames (0 to {times[-1]:.2f} s)"
    start = _frame_at(excerpt.start, times) if excerpt.start else 0
    end = min(_frame_at(excerpt.end, times) if excerpt.end else len(times), len(times))
    if start >= len(times):
        raise VideoError(
            f"{source}: video.start = {excerpt.start} is behind {length}; give an earlier --start"
        )
    if start >= end:
        raise VideoError(
            f"{source}: video.start = {excerpt.start or 0} is not before video.end = {excerpt.end}, of {length}; change one"
        )
    used = range(start, end, excerpt.every)
    if len(used) < 2:
        raise VideoError(
            f"{source}: video.start, video.end and video.every leave one of {length}; motion needs two at least"
        )
    return used


def _frame_at(text: str, times: Sequence[float]) -> int:
    """The frame that ``300f``, ``12.5`` or ``1:02:03.5`` means: the first at or after that time."""
    if text.endswith("f"):
        return int(text[:-1])
    parts = map(float, text.removesuffix("s").split(":"))
    return int(np.searchsorted(times, reduce(lambda whole, part: 60 * whole + part, parts) - EARLY))
