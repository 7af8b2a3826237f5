"""A video: which frames are used, when they are shown and how they are called; reading them by index, exactly."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from zsmoseg import settings
from zsmoseg.decoding import decoder, index
from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.sources import image_files

WIDTH, HEIGHT, ORIENTATION = 0x0100, 0x0101, 0x0112
"""EXIF tags; orientations from 5 on swap the sides."""


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
    """As displayed: rotation applied; the shape of pixels is not."""
    indices: tuple[int, ...] = ()
    """Of the used frames among all frames of the source."""
    total: int = 0
    """Frames of the source, used or not."""

    @property
    def kind(self) -> str:
        """``images`` or ``file``."""
        return "images" if self.files else "file"

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

    Returns
    -------
    Its used frames, with absolute paths: workers may stand in another folder.

    Raises
    ------
    VideoError
        Not a video; fewer than two frames; images of different sizes; damaged (unless ``s.allow_truncated``);
        ``start``, ``end`` and ``every`` leave fewer than two frames.
    """
    files = image_files(source)
    if files:
        return _probe_images(source, files, s)
    if os.path.isdir(source):
        raise VideoError(f"{source}: holds no frames; give a folder of images (jpg, png, tif, bmp, webp)")
    if not os.path.exists(source):
        raise VideoError(f"{source}: no such file or folder")
    return _probe_file(source, s)


def _probe_images(source: str, files: list[str], s: settings.Video) -> Probe:
    used = _used([i / s.fps for i in range(len(files))], source, s)
    chosen = [os.path.abspath(files[i]) for i in used]
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
    where = os.path.abspath(source)
    return Probe(
        where, tuple(chosen), (), (), tuple(names), times, *sizes[0], indices=tuple(used), total=len(files)
    )


def _image_size(file: str) -> tuple[int, int]:
    """(width, height) as displayed, from the header."""
    try:
        with Image.open(file) as image:
            tags = image.getexif()
            width, height = image.size
            if image.format == "TIFF":  # Pillow may have turned it
                width, height = int(tags[WIDTH]), int(tags[HEIGHT])
            return (height, width) if tags.get(ORIENTATION, 1) >= 5 else (width, height)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise _unreadable(file) from error


def _unreadable(file: str, why: str = "cannot be read as an image") -> VideoError:
    return VideoError(f"{file}: {why}; replace it or take it out of the folder")


def _other_size(what: str, image: NDArray[Any], probe: Probe) -> VideoError:
    return VideoError(
        f"{what}: is {image.shape[1]} x {image.shape[0]}, expected {probe.width} x {probe.height}; "
        "all frames of a video must have one size"
    )


def _probe_file(source: str, s: settings.Video) -> Probe:
    found = index(source, thorough=s.allow_truncated)
    if found.decodable < found.promised and not s.allow_truncated:
        raise VideoError(
            f"{source}: is damaged or cut off: frames 0 to {found.decodable - 1} of {found.promised} can be decoded, "
            f"frame {found.decodable} cannot; --allow-truncated goes on with those"
        )
    pts = found.pts[: found.decodable]
    times = [(p - pts[0]) * found.time_base for p in pts]
    used = _used(times, source, s)
    return Probe(
        os.path.abspath(source),
        (),
        tuple(pts[i] for i in used),
        found.keys,
        tuple(f"{i:05d}" for i in used),
        tuple(times[i] for i in used),
        found.width,
        found.height,
        indices=tuple(used),
        total=len(times),
    )


def _used(times: list[float], source: str, s: settings.Video) -> range:
    """The frames between start and end, every n-th."""
    if len(times) < 2:
        raise VideoError(f"{source}: has {len(times)} frame; motion needs two at least")
    length = f"its {len(times)} frames (0 to {times[-1]:.2f} s)"
    start = _frame_at(s.start, times) if s.start else 0
    end = min(_frame_at(s.end, times) if s.end else len(times), len(times))
    if start >= len(times):
        raise VideoError(f"{source}: video.start = {s.start} is behind {length}; give an earlier --start")
    if start >= end:
        raise VideoError(
            f"{source}: video.start = {s.start or 0} is not before video.end = {s.end}, of {length}; change one"
        )
    used = range(start, end, s.every)
    if len(used) < 2:
        raise VideoError(
            f"{source}: video.start, video.end and video.every leave one of {length}; motion needs two at least"
        )
    return used


def _frame_at(text: str, times: list[float]) -> int:
    """The frame that ``300f`` or ``12.5`` means: the first at or after that time."""
    if text.endswith("f"):
        return int(text[:-1])
    return int(np.searchsorted(times, float(text.removesuffix("s")) - 1e-9))


def read(probe: Probe, start: int, stop: int) -> Iterator[NDArray[np.uint8]]:
    """Frames ``start`` to ``stop - 1`` of the used ones: (H, W, 3) blue green red, 8 bit, as displayed.

    16-bit images are divided by 257 (65535 becomes 255), grey is repeated, alpha is dropped.

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
        index = probe.indices[number] if probe.indices else int(probe.names[number])
        try:
            image = next(images)
        except VideoError as error:
            raise VideoError(
                f"{probe.source}: frame {index} ({probe.times[number]:.2f} s) cannot be decoded; "
                f"--end {index}f stops before it"
            ) from error
        if image.shape[:2] != (probe.height, probe.width):
            raise _other_size(f"{probe.source}: frame {index}", image, probe)
        yield image


def _read_image(file: str, probe: Probe) -> NDArray[np.uint8]:
    pixels = _pixels(file)
    if pixels is None:
        raise _unreadable(file, "cannot be read as an image, or is cut off")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise _unreadable(file, f"has {pixels.dtype} pixels, expected 8 or 16 bit")
    if pixels.shape[:2] != (probe.height, probe.width):
        raise _other_size(file, pixels, probe)
    return pixels if pixels.dtype == np.uint8 else ((pixels.astype(np.uint32) + 128) // 257).astype(np.uint8)


def _pixels(file: str) -> NDArray[Any] | None:
    """(H, W, 3) as displayed, at the depth of the file; None where it is no image or cut off."""
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise _unreadable(file, f"cannot be read ({error.strerror})") from error
    if not content or _cut_off(content):
        return None
    try:
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
        return cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        return None


def _cut_off(content: bytes) -> bool:
    """Whether a JPEG or PNG lacks its end, which decoders fill with grey or black and do not mention."""
    if content.startswith(b"\xff\xd8"):  # the last scan does not end; the markers cannot occur within a scan
        return content.rfind(b"\xff\xd9") < content.rfind(b"\xff\xda")
    return content.startswith(b"\x89PNG") and b"IEND" not in content


def read_ignore(path: str, height: int, width: int) -> NDArray[np.bool_]:
    """(height, width) true where the image ``path`` is not zero, resized to the nearest.

    Raises
    ------
    SettingsError
        If it cannot be read.
    """
    try:
        image = _pixels(path)
    except VideoError:
        image = None
    if image is None:
        raise SettingsError(f"{path}: the ignore mask cannot be read as an image; give a PNG to --ignore")
    mask = (image != 0).any(axis=2).astype(np.uint8)
    return np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0)
