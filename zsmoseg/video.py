"""A video: which frames are used, when they are shown and how they are called; reading them by index, exactly."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from zsmoseg import settings
from zsmoseg.decoding import decoder, index
from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.sources import image_files

ORIENTATION = 0x0112
"""EXIF tag; values from 5 on swap the sides."""


@dataclass(frozen=True)
class Probe:
    """The used frames of a source, in order."""

    source: str
    files: tuple[str, ...]
    """One a frame for images; empty for a video file."""
    pts: tuple[int, ...]
    """Presentation times in the file's units; empty for images."""
    keys: tuple[int, ...]
    """Presentation times of the key frames of the file."""
    names: tuple[str, ...]
    """Of the files written for each frame."""
    times: tuple[float, ...]
    """Seconds from the start of the source."""
    width: int
    height: int
    """As displayed: rotation applied."""

    def to_json(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Probe:
        """From JSON."""
        lists = {name: tuple(value) for name, value in content.items() if isinstance(value, list)}
        return cls(**{**content, **lists})


def probe(source: str, s: settings.Video) -> Probe:
    """Look at a source without decoding it all.

    Parameters
    ----------
    source : a video file, a folder of images, or a glob of images.

    Raises
    ------
    VideoError
        Not a video; fewer than two frames; images of different sizes; damaged (unless ``s.allow_truncated``).
    SettingsError
        ``start`` or ``end`` leave nothing.
    """
    if not os.path.exists(source) and not image_files(source):
        raise VideoError(f"{source}: no such file or folder")
    return _probe_images(source, s) if image_files(source) else _probe_file(source, s)


def _probe_images(source: str, s: settings.Video) -> Probe:
    files = image_files(source)
    used = _used([i / s.fps for i in range(len(files))], source, s)
    chosen = [files[i] for i in used]
    sizes = [_image_size(f) for f in chosen]
    for file, size in zip(chosen, sizes, strict=True):
        if size != sizes[0]:
            raise VideoError(
                f"{file}: is {size[0]} x {size[1]}, {os.path.basename(chosen[0])} is {sizes[0][0]} x {sizes[0][1]}; "
                "all frames of a folder must have one size"
            )
    stems = [os.path.splitext(os.path.basename(f))[0] for f in chosen]
    names = stems if len(set(stems)) == len(stems) else [f"{i:05d}" for i in used]
    times = tuple(i / s.fps for i in used)
    return Probe(source, tuple(chosen), (), (), tuple(names), times, *sizes[0])


def _image_size(file: str) -> tuple[int, int]:
    """(width, height) as displayed, from the header."""
    try:
        with Image.open(file) as image:
            width, height = image.size
            return (height, width) if image.getexif().get(ORIENTATION, 1) >= 5 else (width, height)
    except (OSError, UnidentifiedImageError) as error:
        raise VideoError(
            f"{file}: cannot be read as an image; replace it or take it out of the folder"
        ) from error


def _probe_file(source: str, s: settings.Video) -> Probe:
    found = index(source)
    if found.decodable < found.promised and not s.allow_truncated:
        raise VideoError(
            f"{source}: is damaged or cut off: frames 0 to {found.decodable - 1} of {found.promised} can be decoded, "
            f"frame {found.decodable} cannot; --allow-truncated goes on with those"
        )
    pts = found.pts[: found.decodable]
    times = [(p - pts[0]) * found.time_base for p in pts]
    used = _used(times, source, s)
    return Probe(
        source,
        (),
        tuple(pts[i] for i in used),
        found.keys,
        tuple(f"{i:05d}" for i in used),
        tuple(times[i] for i in used),
        found.width,
        found.height,
    )


def _used(times: list[float], source: str, s: settings.Video) -> range:
    """The frames between start and end, every n-th."""
    if len(times) < 2:
        raise VideoError(f"{source}: has {len(times)} frame; motion needs two at least")
    start = _frame_at(s.start, times) if s.start else 0
    end = min(_frame_at(s.end, times) if s.end else len(times), len(times))
    used = range(start, end, s.every)
    if len(used) < 2:
        raise SettingsError(
            f"{source}: video.start, video.end and video.every leave {len(used)} of its {len(times)} frames "
            f"({times[-1]:.2f} s); motion needs two at least"
        )
    return used


def _frame_at(text: str, times: list[float]) -> int:
    """The frame that ``300f`` or ``12.5`` means: the first at or after that time."""
    if text.endswith("f"):
        return int(text[:-1])
    return int(np.searchsorted(times, float(text.removesuffix("s")) - 1e-9))


def read(probe: Probe, start: int, stop: int) -> Iterator[NDArray[np.uint8]]:
    """Frames ``start`` to ``stop - 1`` of the used ones: (H, W, 3) blue green red, 8 bit, as displayed.

    16-bit images are reduced to 8 bit, grey is repeated, alpha is dropped.

    Raises
    ------
    VideoError
        At the first frame that cannot be read.
    """
    if probe.files:
        for file in probe.files[start:stop]:
            yield _read_image(file, probe)
        return
    images = decoder(probe.source, probe.keys).frames(probe.pts[start:stop])
    for number in range(start, stop):
        try:
            yield next(images)
        except VideoError as error:
            raise VideoError(
                f"{probe.source}: frame {probe.names[number]} ({probe.times[number]:.2f} s) cannot be decoded; "
                f"--end {int(probe.names[number])}f stops before it"
            ) from error


def _read_image(file: str, probe: Probe) -> NDArray[np.uint8]:
    image = cv2.imread(file, cv2.IMREAD_COLOR)
    if image is None:
        raise VideoError(f"{file}: cannot be read as an image; replace it or take it out of the folder")
    if image.shape[:2] != (probe.height, probe.width):
        raise VideoError(
            f"{file}: is {image.shape[1]} x {image.shape[0]}, expected {probe.width} x {probe.height}; "
            "all frames of a folder must have one size"
        )
    return np.asarray(image, np.uint8)


def read_ignore(path: str, height: int, width: int) -> NDArray[np.bool_]:
    """(height, width) true where the image ``path`` is not zero.

    Raises
    ------
    SettingsError
        If it cannot be read.
    """
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SettingsError(f"{path}: the ignore mask cannot be read as an image; give a PNG to --ignore")
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0)
