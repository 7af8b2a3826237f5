"""What the packets of a video file say: its frames, their times, and up to where they can be decoded."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import av
import av.error
import numpy as np

from zsmoseg.errors import VideoError
from zsmoseg.video.bounds import TooLarge, check_size
from zsmoseg.video.decoding import Decoder, UInt8, media

REORDER = 16
"""Frames that a codec may store out of order (H.264 and HEVC)."""
UNKNOWN_TIME_BASE = 0.04
"""Seconds, a frame at 25 a second, where a stream does not say its unit of time."""
LACKING = 3
"""Longest distances of frames that the end must lack to be called cut off: headers round, last frames vary."""
GAP = 1.5
"""Usual distances of frames from which one lacks between two."""


@dataclass(frozen=True)
class Index:
    """What the packets of a file say: no frame but the first and the last group is decoded."""

    pts: tuple[int, ...]
    """Presentation times of the frames in order, in units of ``time_base``."""
    keys: tuple[int, ...]
    """Presentation times of the key frames."""
    time_base: float
    height: int
    width: int
    """As displayed."""
    decodable: int
    """Frames up to the first that cannot be decoded, by a look at the end (all, where that is damaged)."""
    promised: int
    """Frames that there should be, by the packets and the duration in the header."""


def index(path: str, thorough: bool = False) -> Index:
    """Look at a file; ``thorough`` decodes all of it, and so finds damage in the middle too.

    Raises
    ------
    VideoError
        If it is not a video or its first frame cannot be decoded.
    """
    try:
        with av.open(media(path)) as container:
            if not container.streams.video:
                raise VideoError(f"{path}: is not a video: it has no picture")
            stream = container.streams.video[0]
            check_size(stream.codec_context.height, stream.codec_context.width)
            every = list(container.demux(stream))
            packets = [p for p in every if p.size and not p.is_discard]
            base, promised = float(stream.time_base or UNKNOWN_TIME_BASE), _duration(container, stream)
            if container.format.name == "avi":
                promised = max(promised, stream.frames * base)
            # AVI tells when a frame is decoded, not when it is shown; that is one unless frames are reordered.
            counted = container.format.name == "avi" and stream.codec_context.has_b_frames
    except TooLarge as error:
        raise VideoError(f"{path}: {error}; make it smaller") from error
    except av.error.FFmpegError as error:
        if isinstance(error, PermissionError | FileNotFoundError):
            raise VideoError(f"{path}: cannot be opened ({error.strerror})") from error
        raise VideoError(
            f"{path}: is not a video, or it is damaged from the start ({error.strerror})"
        ) from error
    if not packets:
        raise VideoError(f"{path}: holds no frame")
    pts = tuple(sorted({p.pts for p in packets if p.pts is not None}))
    if counted or len(pts) < len(packets):
        return _decode_all(path, base, len(packets), promised)
    keys = tuple(sorted(p.pts for p in packets if p.is_keyframe)) or pts[:1]
    return _by_time(path, pts, keys, base, promised - _shown(packets, pts) * base, thorough)


def _shown(packets: Sequence[Any], pts: Sequence[int]) -> int:
    """How long the frames are shown that are there, in units of time."""
    step = int(np.median(np.diff(pts))) if len(pts) > 1 else 0
    return int(max(p.pts + (p.duration or step) for p in packets)) - pts[0]


def _by_time(
    path: str, pts: tuple[int, ...], keys: tuple[int, ...], base: float, rest: float, thorough: bool
) -> Index:
    """Index of a file with presentation times of which ``rest`` seconds seem to lack at the end."""
    decoder = Decoder(path, keys)
    try:
        first = _first(decoder, pts[0])
        if first is None:  # the source was cut out before an open group: frames that lean on what was cut off
            pts = pts[bisect_left(pts, keys[0]) :]
            first = _first(decoder, pts[0]) if pts else None
    finally:
        decoder.close()
    if first is None:
        raise VideoError(f"{path}: is not a video, or it is damaged: its first frame cannot be decoded")
    steps = np.diff(pts) * base if len(pts) > 1 else np.array([rest])
    lacking = round(rest / float(np.median(steps))) if rest > LACKING * steps.max() else 0
    group = bisect_left(pts, max((k for k in keys if k <= pts[-1]), default=pts[0]))
    whole = not thorough and not lacking and _good(path, pts[group:], keys) == len(pts) - group
    step = float(np.median(steps)) / base
    decodable = len(pts) if whole else _good(path, _before_gap(pts, step) if lacking else pts, keys)
    height, width = first.shape[:2]
    return Index(pts, keys, base, height, width, decodable, len(pts) + lacking)


def _first(decoder: Decoder, pts: int) -> UInt8 | None:
    try:
        return next(decoder.frames([pts]))
    except VideoError:
        return None


def _before_gap(pts: tuple[int, ...], step: float) -> tuple[int, ...]:
    """A file that is cut off lacks some of the frames that are shown before the last ones it holds."""
    first = max(len(pts) - REORDER, 1)
    gaps = [n for n in range(first, len(pts)) if pts[n] - pts[n - 1] > GAP * step]
    return pts[: gaps[0]] if gaps else pts


def _duration(container: Any, stream: Any) -> float:
    """Seconds of the picture by the headers; 0 where they do not say."""
    if stream.duration:
        return float(stream.duration * stream.time_base)
    if "DURATION" in stream.metadata:
        hours, minutes, seconds = stream.metadata["DURATION"].split(":")
        return int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    alone = len(container.streams) == 1 and container.duration
    return float(container.duration / av.time_base) if alone else 0.0


def _good(path: str, pts: Sequence[int], keys: Sequence[int]) -> int:
    """Frames up to the first that does not come out; 0 only if none does."""
    good, decoder = 0, Decoder(path, keys)
    try:
        for _ in decoder.frames(pts):
            good += 1
    except VideoError:
        pass
    decoder.close()
    return good


def _decode_all(path: str, base: float, packets: int, promised: float) -> Index:
    """For AVI, and where presentation times lack: frames are counted, ``base`` seconds apart."""
    decoder = Decoder(path, ())
    good = _good(path, range(packets), ())
    if not good:
        raise VideoError(f"{path}: is not a video, or it is damaged: its first frame cannot be decoded")
    height, width = next(iter(decoder.frames([0]))).shape[:2]
    return Index(tuple(range(good)), (), base, height, width, good, max(packets, round(promised / base) - 1))
