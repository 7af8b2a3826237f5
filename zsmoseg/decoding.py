"""Frames of a video file by presentation time, exactly, whatever the order they are asked for in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import av
import av.error
import numpy as np
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


def index(path: str) -> Index:
    """Look at a file.

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
            packets = [(p.pts, bool(p.is_keyframe)) for p in every if p.size and not p.is_discard]
            base, promised = float(stream.time_base or 0.04), _duration(container, stream)
            counted = container.format.name == "avi"
            if counted and stream.average_rate:
                base = float(1 / stream.average_rate)
    except av.error.FFmpegError as error:
        raise VideoError(
            f"{path}: is not a video, or it is damaged from the start ({error.strerror})"
        ) from error
    if not packets:
        raise VideoError(f"{path}: holds no frame")
    if counted or any(pts is None for pts, _ in packets):
        return _decode_all(path, base, len(packets), promised)
    pts = tuple(sorted({pts for pts, _ in packets}))
    keys = tuple(sorted(pts for pts, key in packets if key)) or pts[:1]
    try:
        first = next(iter(Decoder(path, keys).frames(pts[:1])))
    except VideoError as error:
        raise VideoError(
            f"{path}: is not a video, or it is damaged: its first frame cannot be decoded"
        ) from error
    step = float(np.median(np.diff(pts))) * base if len(pts) > 1 else promised
    lacking = round((promised - (pts[-1] - pts[0]) * base - step) / step) if promised else 0
    last = pts[pts.index(max(k for k in keys if k in pts)) :]
    whole = lacking <= 1 and _good(path, last, keys) == len(last)
    decodable = len(pts) if whole else _good(path, _before_gap(pts, step / base), keys)
    return Index(
        pts, keys, base, first.shape[0], first.shape[1], decodable, len(pts) + (lacking if lacking > 1 else 0)
    )


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
    good = 0
    try:
        for _ in Decoder(path, keys).frames(pts):
            good += 1
    except VideoError:
        pass
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
    """BGR as displayed: the display matrix is applied, alpha dropped."""
    image = frame.to_ndarray(format="bgr24")
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns) if turns else image)


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
        key = int(self.keys[: np.searchsorted(self.keys, pts, "right")].max(initial=self.first))
        earlier = iter(sorted({int(k) for k in self.keys[self.keys < key]}, reverse=True))
        if self._next is None or not key <= self._next <= pts:
            self._start(key)
        while True:
            try:
                for now, frame in self._stream:
                    self._next = now + 1
                    if now == pts:
                        if frame.is_corrupt:
                            break
                        return _picture(frame)
                    if now > pts:
                        break
                else:
                    now = -1
            except av.error.FFmpegError:
                break
            before = next(earlier, None)
            if before is None or now <= pts:
                break
            self._start(before)
        self.close()
        raise VideoError(f"{self.path}: the frame at time {pts} cannot be decoded")

    def _start(self, key: int) -> None:
        """Open, and seek to the key frame at or before ``key``."""
        self.close()
        try:
            self._container = av.open(self.path)
        except av.error.FFmpegError as error:
            raise VideoError(f"{self.path}: cannot be opened ({error.strerror})") from error
        stream = self._container.streams.video[0]
        stream.codec_context.thread_count = 1
        if key > self.first:
            self._container.seek(key, stream=stream, backward=True)
        decoded = self._container.decode(stream)
        if len(self.keys):
            self._stream = ((f.pts, f) for f in decoded if f.pts is not None)
        else:
            self._stream = enumerate(decoded)

    def close(self) -> None:
        """Let go of the file."""
        if self._container is not None:
            self._container.close()
        self._container, self._stream, self._next = None, iter(()), None


@lru_cache(maxsize=1)
def decoder(path: str, keys: tuple[int, ...]) -> Decoder:
    """The decoder of a file that this process used last: chunks in order go on without a seek."""
    return Decoder(path, keys)
