"""What the packets of a video file say: its frames, their times, and up to where they can be decoded."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from typing import Any, NamedTuple

import av
import av.error
import numpy as np
from av.stream import Disposition

from zsmoseg.errors import VideoError
from zsmoseg.video import times
from zsmoseg.video.bounds import TooLarge, check_size
from zsmoseg.video.decoding import Decoder, UInt8, Way, carries_frame, opened
from zsmoseg.video.wholeness import is_cut_off

REORDER = 16
"""Frames that a codec may store out of order (H.264 and HEVC)."""
LACKING = 3
"""Longest distances of frames that the end must lack to be worth a word: headers round, last frames vary."""
GAP = 1.5
"""Usual distances of frames from which one lacks between two."""
JUMP, JUMP_ELSEWHERE = 10.0, 30 * 3600.0
"""Seconds from one frame to the next that are a jump of the clock, in broadcast streams and in others (FFmpeg's
``-dts_delta_threshold`` and ``-dts_error_threshold``)."""
BROADCAST = 0x0200
"""Of a format of FFmpeg: its clock may start again (``AVFMT_TS_DISCONT``)."""
STILL = Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image
"""Of streams that are pictures of a video."""
PIPED = 1 << 30
"""Frames that FFmpeg writes into the head of an AVI before it knows how many there will be."""
SAME_LENGTH = 0.9
"""Share of the length of the longest stream from which another is as long."""


class Packet(NamedTuple):
    """What a packet says."""

    pts: int | None
    key: bool
    duration: int
    hidden: bool
    """Its picture is for other pictures to lean on."""


@dataclass(frozen=True)
class Heard:
    """What a container says of its video."""

    way: Way
    packets: list[Packet]
    base: Fraction
    """Seconds, the unit of time."""
    rate: Fraction | None
    """1/s, by the stream itself before what is made of times."""
    duration: float
    """Seconds of the picture; 0 where nothing is said."""
    format: str
    broadcast: bool
    """Whether its clock may start again."""
    decoding_times: bool
    """Whether the times are those of decoding."""


@dataclass(frozen=True)
class Index:
    """What the packets of a file say: where they can be trusted no frame but the first and the last group is decoded."""

    way: Way
    pts: tuple[int, ...]
    """Presentation times of the frames in order, as ``way`` takes them."""
    seconds: tuple[float, ...]
    """From the first frame."""
    height: int
    width: int
    """As displayed."""
    decodable: int
    """Frames up to the first that cannot be decoded, by a look at the end (all, where that is damaged)."""
    whole: bool
    """Whether nothing seems to be missing behind them."""
    notes: tuple[str, ...]
    """What the container says and is not believed."""


def index(path: str, thorough: bool = False) -> Index:
    """Look at a file; ``thorough`` decodes all of it, and so finds damage in the middle too.

    Raises
    ------
    VideoError
        If it is not a video or its first frame cannot be decoded.
    """
    try:
        with opened(path) as container:
            heard = _listen(path, container)
    except TooLarge as error:
        raise VideoError(f"{path}: {error}; make it smaller") from error
    except av.error.FFmpegError as error:
        if isinstance(error, PermissionError | FileNotFoundError):
            raise VideoError(f"{path}: cannot be opened ({error.strerror})") from error
        raise VideoError(
            f"{path}: is not a video, or it is damaged from the start ({error.strerror})"
        ) from error
    if not heard.packets:
        raise VideoError(f"{path}: holds no frame")
    return _by_time(path, heard, thorough) if _is_timed(heard) else _by_place(path, heard)


# ---------------------------------------------------------------------- which stream
def _listen(path: str, container: Any) -> Heard:
    """What a container says of the stream that is its video: the default, else the longest."""
    real = [s for s in container.streams.video if not s.disposition & STILL and s.codec_context]
    if not real:
        raise VideoError(f"{path}: has no video{_instead(container)}")
    packets: dict[int, list[Packet]] = {s.index: [] for s in real}
    for packet in container.demux(real):
        if carries_frame(packet):
            packets[packet.stream.index].append(_packet(packet))
    moving = [s for s in real if len(packets[s.index]) > 1] or real
    stream = _longest([s for s in moving if s.disposition & Disposition.default] or moving, packets)
    context, avi = stream.codec_context, container.format.name == "avi"
    check_size(context.height, context.width)
    return Heard(
        Way(stream.index),
        packets[stream.index],
        stream.time_base or Fraction(1, 1000),
        context.framerate or stream.guessed_rate,
        _duration(container, stream),
        container.format.name,
        bool(container.format.flags & BROADCAST),
        # AVI tells when a frame is decoded, not when it is shown; that is one unless frames are reordered.
        avi and bool(context.has_b_frames),
    )


def _instead(container: Any) -> str:
    """What there is where there is no video."""
    kinds = [("sound", container.streams.audio), ("a picture of it", container.streams.video)]
    found = [word for word, streams in kinds if streams]
    return f", only {' and '.join(found)}" if found else ""


def _packet(packet: Any) -> Packet:
    """VP8 says in its first byte whether a frame is shown (RFC 6386, 9.1); other codecs pack those that are not."""
    hidden = packet.stream.codec_context.name == "vp8" and not memoryview(packet)[0] & 0x10
    return Packet(packet.pts, packet.is_keyframe, packet.duration or 0, hidden)


def _longest(streams: Sequence[Any], packets: dict[int, list[Packet]]) -> Any:
    """The longest stream; of those as long the one with most pixels, then the first."""
    lengths = {s.index: _length(packets[s.index]) * float(s.time_base or 0) for s in streams}
    long = [s for s in streams if lengths[s.index] >= SAME_LENGTH * max(lengths.values())]
    sizes = [s.codec_context.height * s.codec_context.width * len(packets[s.index]) for s in long]
    return long[sizes.index(max(sizes))]


def _length(packets: Sequence[Packet]) -> int:
    """From the first to the last time that is said."""
    said = [p.pts for p in packets if p.pts is not None]
    return max(said) - min(said) if said else 0


def _duration(container: Any, stream: Any) -> float:
    """Seconds of the picture by the headers; 0 where they do not say."""
    if container.format.name == "avi" and not 0 < stream.frames < PIPED:
        return 0.0  # FFmpeg guesses by the size of the file
    if stream.duration:
        return float(stream.duration * stream.time_base)
    said = [container.duration / av.time_base] if container.duration else []
    try:
        hours, minutes, seconds = map(float, stream.metadata["DURATION"].split(":"))
        said.append(hours * 3600 + minutes * 60 + seconds)
    except (KeyError, ValueError):  # not there, or no number
        said = said if len(container.streams) == 1 else []
    return max(min(said, default=0.0), 0.0)


# ---------------------------------------------------------------------- by times
def _is_timed(heard: Heard) -> bool:
    """Whether every frame is found by its time: each has one of its own, and they never start again."""
    shown = [p for p in heard.packets if not p.hidden]
    pts = [p.pts for p in shown if p.pts is not None]
    if heard.decoding_times or not shown or len(set(pts)) < len(shown):
        return False
    latest = list(accumulate(pts, max))
    restarts = any(p.key and latest[n - 1] > pts[n] for n, p in enumerate(shown) if n)
    return not restarts and all(late < now for late, now in zip(latest, pts[REORDER:], strict=False))


def _by_time(path: str, heard: Heard, thorough: bool) -> Index:
    """Index of a file with presentation times."""
    shown = [p for p in heard.packets if not p.hidden]
    pts = tuple(sorted(p.pts for p in shown if p.pts is not None))
    keys = tuple(sorted(p.pts for p in shown if p.key and p.pts is not None)) or pts[:1]
    way, base = Way(heard.way.stream, keys), float(heard.base)
    before = len(pts)
    pts, first = _first(path, way, pts)
    steps = np.diff(pts) if len(pts) > 1 else np.array([1])
    rest = heard.duration - _seen(shown, int(np.median(steps))) * base
    lacking = rest > LACKING * steps.max() * base
    cut = (lacking or not heard.duration) and is_cut_off(path, heard.format)
    group = bisect_left(pts, max((k for k in keys if k <= pts[-1]), default=pts[0]))
    whole = not thorough and not cut and _good(path, way, pts[group:]) == len(pts) - group
    decodable = (
        len(pts) if whole else _good(path, way, _before_gap(pts, float(np.median(steps))) if cut else pts)
    )
    clock = times.settle([(p - pts[0]) * base for p in pts], heard.rate, _jump(heard))
    height, width = first.shape[:2]
    notes = _notes(clock, len(pts), rest if lacking and not cut else 0.0)
    if early := before - len(pts):
        notes += (
            f"its first {early} of {before} frames cannot be decoded by themselves: they are passed over",
        )
    done = decodable == len(pts) and not cut
    return Index(way, pts, tuple(clock.times), height, width, decodable, done, notes)


def _first(path: str, way: Way, pts: tuple[int, ...]) -> tuple[tuple[int, ...], UInt8]:
    """The times from the first frame that can be decoded on, and its picture.

    A source that was cut out of another may begin before a key frame, with an open group, or where pictures are refreshed
    bit by bit.

    Raises
    ------
    VideoError
        If none comes out, or the first key frame is damaged.
    """
    for find in (lambda: pts[0], lambda: way.keys[0], Decoder(path, way).earliest):
        start = find()
        rest = () if start is None else pts[bisect_left(pts, start) :]
        first = _picture(path, way, rest[0]) if rest else None
        if first is not None:
            return rest, first
    raise VideoError(f"{path}: is not a video, or it is damaged: its first frame cannot be decoded")


def _seen(packets: Sequence[Packet], step: int) -> int:
    """How long the frames are shown that are there, in units of time."""
    times = [(p.pts, p.duration or step) for p in packets if p.pts is not None]
    return max(start + shown for start, shown in times) - min(times)[0]


def _picture(path: str, way: Way, pts: int) -> UInt8 | None:
    """One frame, None where it cannot be decoded."""
    decoder = Decoder(path, way)
    try:
        return next(decoder.frames([pts]))
    except VideoError:
        return None
    finally:
        decoder.close()


def _before_gap(pts: tuple[int, ...], step: float) -> tuple[int, ...]:
    """A file that is cut off lacks some of the frames that are shown before the last ones it holds."""
    first = max(len(pts) - REORDER, 1)
    gaps = [n for n in range(first, len(pts)) if pts[n] - pts[n - 1] > GAP * step]
    return pts[: gaps[0]] if gaps else pts


def _good(path: str, way: Way, pts: Sequence[int]) -> int:
    """Frames up to the first that does not come out; 0 only if none does."""
    good, decoder = 0, Decoder(path, way)
    try:
        for _ in decoder.frames(pts):
            good += 1
    except VideoError:
        pass
    decoder.close()
    return good


# ---------------------------------------------------------------------- by places
def _by_place(path: str, heard: Heard) -> Index:
    """Index of a file whose times do not tell its frames apart: all is decoded once, to see which packet is shown when."""
    packets, stream = heard.packets, heard.way.stream
    keys = [n for n, p in enumerate(packets) if p.key] or [0]
    decoder = Decoder(path, Way(stream, (keys[0],), tuple(range(len(packets)))))
    came, sound = decoder.shown()
    order = list(dict.fromkeys(came))
    if not order:
        raise VideoError(f"{path}: is not a video, or it is damaged: its first frame cannot be decoded")
    ranks = [-1] * len(packets)
    for place, number in enumerate(order):
        ranks[number] = place
    way = Way(stream, tuple(sorted({ranks[n] for n in keys} - {-1})) or (0,), tuple(ranks))
    first = _picture(path, way, 0)
    if first is None:
        raise VideoError(f"{path}: is not a video, or it is damaged: its first frame cannot be decoded")
    start = next((pts for n in order if (pts := packets[n].pts) is not None), 0)
    said = [None if (pts := packets[n].pts) is None else float((pts - start) * heard.base) for n in order]
    clock = times.settle([None] * len(said) if heard.decoding_times else said, heard.rate, _jump(heard))
    last = max(n for n, p in enumerate(packets) if not p.hidden)
    whole = sound and max(order) == last and not is_cut_off(path, heard.format)
    height, width = first.shape[:2]
    notes = () if heard.decoding_times else _notes(clock, len(order), 0.0)
    if without := sum(rank < 0 and not p.hidden for rank, p in zip(ranks, packets, strict=True)):
        notes += (f"{without} of {len(packets)} packets give no frame: they are passed over",)
    return Index(way, tuple(range(len(order))), tuple(clock.times), height, width, len(order), whole, notes)


# ---------------------------------------------------------------------- what is said of it
def _jump(heard: Heard) -> float:
    return JUMP if heard.broadcast else JUMP_ELSEWHERE


def _notes(clock: times.Clock, frames: int, rest: float) -> tuple[str, ...]:
    """What of the container is not believed, a line each."""
    notes = []
    if not clock.believed:
        step = clock.times[1] - clock.times[0] if frames > 1 else times.USUAL
        notes.append(f"its frames carry no times that make sense: {1 / step:.6g} a second are taken")
    elif clock.unsaid:
        notes.append(
            f"{clock.unsaid} of {frames} frames carry no time of their own: they are put between their neighbours"
        )
    if clock.restarts:
        more = len(clock.restarts) - 1
        notes.append(
            f"its clock jumps or starts again at frame {clock.restarts[0]}"
            f"{f' and {more} more' if more else ''}: times go on from there without a gap"
        )
    if rest:
        notes.append(f"its header promises {rest:.2f} s more than there are: what is there is taken")
    return tuple(notes)
