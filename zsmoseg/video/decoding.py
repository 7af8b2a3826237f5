"""Frames of a video file by presentation time, exactly, whatever the order they are asked for in."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import dropwhile
from pathlib import Path
from typing import Any

import av
import av.error
import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

from zsmoseg.errors import VideoError
from zsmoseg.video import places
from zsmoseg.video.bounds import PIXELS

UInt8 = NDArray[np.uint8]
LIMIT = {"max_pixels": str(PIXELS)}
"""For FFmpeg: a stream may state another size in its middle than in its head."""
ELSEWHERE = {
    "concat",
    "dash",
    "hls",
    "image2",
    "imf",
    "lavfi",
    "rtp",
    "rtsp",
    "sap",
    "sdp",
    "vobsub",
    "webm_dash_manifest",
}
"""Formats of FFmpeg that say where the pictures are instead of holding them."""
OWN = {"format_whitelist": ",".join(sorted(av.formats_available - ELSEWHERE)), "protocol_whitelist": "file"}
"""For FFmpeg: what a file does not hold itself is in no fingerprint, and is not looked for."""
HEAD = 1 << 10
"""Bytes that tell text from pictures."""


@classmethod  # type: ignore[misc]
def _unnamed(cls: type[Type], value: int) -> Type:
    """A kind of side data that FFmpeg has and PyAV does not name; without it none of a frame could be looked at."""
    kind = object.__new__(cls)
    kind._name_, kind._value_ = f"UNNAMED_{value}", value  # type: ignore[assignment]
    return kind


Type._missing_ = _unnamed  # type: ignore[method-assign, assignment]


def media(path: str | Path) -> str:
    """A path, or the copy of a URL, as FFmpeg takes it: what stands before a colon in it is no protocol."""
    return f"file:{places.here(str(path))}"


def opened(path: str) -> Any:
    """A video file, to be read.

    Raises
    ------
    VideoError
        If it names other files instead of holding pictures.
    av.error.FFmpegError
        If FFmpeg cannot open it.
    """
    try:
        return av.open(media(path), options=OWN)
    except av.error.ArgumentError as error:
        if not _is_text(path):
            raise
        raise VideoError(
            f"{path}: is a list of other files, which may change without anybody seeing it; join them into one file first "
            f"(ffmpeg -i {Path(path).name} -c copy joined.mkv)"
        ) from error


def _is_text(path: str) -> bool:
    """Whether a file begins as lists do, and pictures do not."""
    with open(places.here(path), "rb") as file:
        return b"\0" not in file.read(HEAD)


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


@dataclass(frozen=True)
class Way:
    """How the frames of a file are found."""

    stream: int = 0
    """Which of its streams is the video."""
    keys: tuple[int, ...] = (0,)
    """Presentation times of the key frames."""
    ranks: tuple[int, ...] = ()
    """Where times are missing, stand twice or start again: of each packet the place at which its frame is shown (-1: it
    has none), which is then what is called presentation time here."""


class Decoder:
    """Decodes one file; goes on where it stands if that is the shortest way."""

    def __init__(self, path: str, way: Way) -> None:
        self.path, self.way, self.keys = path, way, np.asarray(way.keys, np.int64)
        self.first = int(self.keys[0])
        self._container: Any = None
        self._stream: Iterator[tuple[int, Any]] = iter(())
        self._next: int | None = None
        self._seeks = not way.ranks
        """Whether frames are looked for from another place than the start; not all formats can."""

    def frames(self, wanted: Sequence[int]) -> Iterator[UInt8]:
        """The frames with the presentation times ``wanted``, ascending.

        Raises
        ------
        VideoError
            At the first that does not come out.
        """
        for pts in wanted:
            yield self._frame(int(pts))

    def shown(self) -> tuple[list[int], bool]:
        """The presentation times of all frames as they come out, up to the first damage; whether there is none."""
        self._start(0, 0)
        order: list[int] = []
        try:
            for now, frame in self._stream:
                if frame.is_corrupt:
                    return order, False
                order.append(now)
        except av.error.FFmpegError:
            return order, False
        finally:
            self.close()
        return order, True

    def earliest(self) -> int | None:
        """The presentation time of the first frame that comes out; None if damage comes first."""
        self._start(0, 0)
        try:
            return next((None if frame.is_corrupt else now for now, frame in self._stream), None)
        except av.error.FFmpegError:
            return None
        finally:
            self.close()

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
        """Whether going on is the shortest way: no whole group of frames lies between that could be left out."""
        if self._next is None or self._next > pts:
            return False
        left_out = self._seeks or bool(self.way.ranks)
        return not left_out or at - int(np.searchsorted(self.keys, self._next)) <= 1

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
        key, sure = (int(self.keys[max(n, 0)]) for n in (at, trusted))
        try:
            self._container = opened(self.path)
        except (av.error.FFmpegError, OSError) as error:
            raise VideoError(f"{self.path}: cannot be opened ({error.strerror})") from error
        stream = self._container.streams[self.way.stream]
        stream.codec_context.thread_count = 1
        stream.codec_context.options = {**LIMIT, "err_detect": "explode"} if self._strict else LIMIT
        if key > self.first and self._seeks:
            try:
                self._container.seek(key, stream=stream, backward=True)
            except av.error.FFmpegError:
                self._seeks = False
                self._start(at, trusted)
                return
        packets = _full(self._container.demux(stream))
        decoded = _decoded(_ranked(packets, self.way.ranks, key) if self.way.ranks else packets, sure)
        self._stream = ((f.pts, f) for f in decoded if f.pts is not None)

    @cached_property
    def _strict(self) -> bool:
        """Damage is not to be painted over, except where an odd encoder makes even the first frame a damage."""
        try:
            with opened(self.path) as container:
                stream = container.streams[self.way.stream]
                stream.codec_context.thread_count = 1
                stream.codec_context.options = {**LIMIT, "err_detect": "explode"}
                packets = dropwhile(lambda p: not p.is_keyframe, _full(container.demux(stream)))
                return next((frame for packet in packets for frame in packet.decode()), None) is not None
        except av.error.FFmpegError:
            return False

    def close(self) -> None:
        """Let go of the file."""
        if self._container is not None:
            self._container.close()
        self._container, self._stream, self._next = None, iter(()), None


def carries_frame(packet: Any) -> bool:
    """Whether a packet has data, and data to be shown."""
    return bool(packet.size) and not packet.is_discard


def _full(packets: Iterable[Any]) -> Iterator[Any]:
    """Without packets that are empty, of frames that were dropped; a decoder takes one for the end, which stays."""
    return (packet for packet in packets if packet.size or packet.dts is None)


def _ranked(packets: Iterable[Any], ranks: Sequence[int], key: int) -> Iterator[Any]:
    """Packets from key frame ``key`` on, with the places of their frames as times."""
    places, begun = iter(ranks), False
    for packet in packets:
        if carries_frame(packet):
            rank = next(places, -1)
            packet.pts = rank if rank >= 0 else None
            begun = begun or rank == key
        if begun:
            yield packet


def _decoded(packets: Iterable[Any], sure: int) -> Iterator[Any]:
    """Frames of packets; those shown before ``sure`` may lean on what was not decoded."""
    for packet in packets:
        try:
            frames = packet.decode()
        except av.error.FFmpegError:
            if packet.pts is None or packet.pts >= sure:
                raise
            continue
        yield from frames


def decoder(path: str, way: Way) -> Decoder:
    """The decoder of a file that this thread used last: chunks in order go on without a seek."""
    try:
        stat = os.stat(places.here(path))
    except OSError as error:
        raise VideoError(f"{path}: cannot be opened ({error.strerror})") from error
    which = path, way, (stat.st_size, stat.st_mtime_ns, stat.st_ino)  # another file may take its place
    if getattr(_KEPT, "which", None) != which:
        _KEPT.which, _KEPT.decoder = which, Decoder(path, way)
    found: Decoder = _KEPT.decoder
    return found


_KEPT = threading.local()
"""One decoder a thread: none may be asked by two."""
