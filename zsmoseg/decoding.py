"""Frames of a video file by presentation time, exactly, whatever the order they are asked for in."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import av
import av.error
import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

from zsmoseg.errors import VideoError

UInt8 = NDArray[np.uint8]
REORDER = 16
"""Frames that a codec may store out of order (H.264 and HEVC)."""


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
        with av.open(path) as container:
            if not container.streams.video:
                raise VideoError(f"{path}: is not a video: it has no picture")
            stream = container.streams.video[0]
            every = list(container.demux(stream))
            packets = [p for p in every if p.size and not p.is_discard]
            base, promised = float(stream.time_base or 0.04), _duration(container, stream)
            if container.format.name == "avi":
                promised = max(promised, stream.frames * base)
            # AVI tells when a frame is decoded, not when it is shown; that is one unless frames are reordered.
            counted = container.format.name == "avi" and stream.codec_context.has_b_frames
    except av.error.FFmpegError as error:
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
    lacking = round(rest / float(np.median(steps))) if rest > 3 * steps.max() else 0
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
    gaps = [n for n in range(first, len(pts)) if pts[n] - pts[n - 1] > 1.5 * step]
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


def _picture(frame: Any) -> UInt8:
    """BGR as displayed: the display matrix (quarter turns and mirrors) is applied, alpha dropped."""
    image = frame.to_ndarray(format="bgr24")
    side = frame.side_data.get(Type.DISPLAYMATRIX)
    if side is None:
        return np.ascontiguousarray(image)
    # Columns of the matrix are where x and y go: x' = a x + c y, y' = b x + d y.
    a, b, _, c, d = np.frombuffer(bytes(side), np.int32)[:5].tolist()
    if abs(b) + abs(c) > abs(a) + abs(d):
        image, a, d = image.transpose(1, 0, 2), c, b
    return np.ascontiguousarray(image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1])


class Decoder:
    """Decodes one file; goes on where it stands if that is the shortest way. ``keys`` empty: count frames."""

    def __init__(self, path: str, keys: Sequence[int]) -> None:
        self.path, self.keys = path, np.asarray(keys, np.int64)
        self.first = int(self.keys[0]) if len(self.keys) else 0
        self._container: Any = None
        self._stream: Iterator[tuple[int, Any]] = iter(())
        self._next: int | None = None

    def frames(self, wanted: Sequence[int]) -> Iterator[UInt8]:
        """The frames with the presentation times ``wanted``, ascending.

        Raises
        ------
        VideoError
            At the first that does not come out.
        """
        for pts in wanted:
            yield self._frame(int(pts))

    def _frame(self, pts: int) -> UInt8:
        at = int(np.searchsorted(self.keys, pts, "right"))
        if not self._near(pts, at):
            self._start(at - 1, at - 1)
        # Twice more: a seek may land behind what was asked for, and a decoder may miss what was shown before
        # an open group although none of its frames needs that.
        for back in (2, 3, None):
            found = self._search(pts)
            if found is not None:
                return found
            if back is None or at < 2:
                break
            self._start(at - back, at - 1)
        self.close()
        raise VideoError(f"{self.path}: the frame at time {pts} cannot be decoded")

    def _near(self, pts: int, at: int) -> bool:
        """Whether going on is the shortest way: no whole group of frames lies between."""
        return (
            self._next is not None
            and self._next <= pts
            and at - int(np.searchsorted(self.keys, self._next)) <= 1
        )

    def _search(self, pts: int) -> UInt8 | None:
        """The frame at ``pts``, or None if it is damaged or does not come."""
        try:
            for now, frame in self._stream:
                self._next = now + 1
                if now >= pts:
                    return _picture(frame) if now == pts and not frame.is_corrupt else None
        except av.error.FFmpegError:
            pass
        return None

    def _start(self, at: int, trusted: int) -> None:
        """Open, and seek to key frame ``at``; what cannot be decoded before key frame ``trusted`` is let pass."""
        self.close()
        key, sure = (int(self.keys[max(n, 0)]) if len(self.keys) else 0 for n in (at, trusted))
        try:
            self._container = av.open(self.path)
        except (av.error.FFmpegError, OSError) as error:
            raise VideoError(f"{self.path}: cannot be opened ({error.strerror})") from error
        stream = self._container.streams.video[0]
        stream.codec_context.thread_count = 1
        if self._strict:
            stream.codec_context.options = {"err_detect": "explode"}
        if key > self.first:
            self._container.seek(key, stream=stream, backward=True)
        decoded = _decoded(self._container, stream, sure)
        if len(self.keys):
            self._stream = ((f.pts, f) for f in decoded if f.pts is not None)
        else:
            self._stream = enumerate(decoded)

    @cached_property
    def _strict(self) -> bool:
        """Damage is not to be painted over, except where an odd encoder makes even the first frame a damage."""
        try:
            with av.open(self.path) as container:
                stream = container.streams.video[0]
                stream.codec_context.thread_count = 1
                stream.codec_context.options = {"err_detect": "explode"}
                return next(container.decode(stream), None) is not None
        except av.error.FFmpegError:
            return False

    def close(self) -> None:
        """Let go of the file."""
        if self._container is not None:
            self._container.close()
        self._container, self._stream, self._next = None, iter(()), None


def _decoded(container: Any, stream: Any, sure: int) -> Iterator[Any]:
    """Frames from where the container stands; those shown before ``sure`` may lean on what was not decoded."""
    for packet in container.demux(stream):
        try:
            frames = packet.decode()
        except av.error.FFmpegError:
            if packet.pts is None or packet.pts >= sure:
                raise
            continue
        yield from frames


def decoder(path: str, keys: tuple[int, ...]) -> Decoder:
    """The decoder of a file that this process used last: chunks in order go on without a seek."""
    try:
        stat = os.stat(path)
    except OSError as error:
        raise VideoError(f"{path}: cannot be opened ({error.strerror})") from error
    return _kept(path, keys, (stat.st_size, stat.st_mtime_ns, stat.st_ino))


@lru_cache(maxsize=1)
def _kept(path: str, keys: tuple[int, ...], stamp: tuple[int, ...]) -> Decoder:
    """One decoder a process; ``stamp`` tells a file from another that took its place."""
    return Decoder(path, keys)
