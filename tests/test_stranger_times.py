"""Videos whose containers say odd things of times: every frame that decodes, in order, at times that can be believed."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from coded import Change, coded, decoded, evenly, look, numbers, write
from runs import segment

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.settings import resolve
from zsmoseg.settings.tree import defaults
from zsmoseg.settings.words import describe
from zsmoseg.video.frames import read
from zsmoseg.video.times import settle

ALL = list(range(40))
FINE = 90_000
"""Ticks a second of transport streams."""


def retick(packet: Any, ticks: int) -> None:
    """The same times in other units."""
    scale = packet.time_base * ticks
    packet.pts, packet.dts = round(packet.pts * scale), round(packet.dts * scale)
    packet.time_base = Fraction(1, ticks)


def at(*places: int, pts: int | None = None, by: int = 0) -> Change:
    """The packets at some places get another time, in ms."""

    def change(n: int, packet: Any) -> None:
        retick(packet, 1000)
        if n in places:
            packet.pts = packet.dts = packet.pts + by if pts is None else pts

    return change


def early(place: int) -> Change:
    """A packet of a frame is shown when the one before is."""

    def change(n: int, packet: Any) -> None:
        retick(packet, 1000)
        packet.pts -= 40 * (n == place)

    return change


def always(pts: int, every: int = 0, tick: Fraction = Fraction(1, 1000)) -> Change:
    def change(n: int, packet: Any) -> None:
        packet.time_base = tick
        packet.pts = packet.dts = pts + n * every

    return change


def moved(seconds: float) -> Change:
    def change(n: int, packet: Any) -> None:
        retick(packet, FINE)
        packet.pts, packet.dts = packet.pts + int(seconds * FINE), packet.dts + int(seconds * FINE)

    return change


def joined(path: Path, *parts: Path) -> Path:
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    return path


def hidden(path: Path, late: int = 0) -> Path:
    """VP8 in which every key frame stands once more before itself and is not shown then."""
    write(path.with_suffix(".ivf"), codec="libvpx", g="8")
    with av.open(str(path.with_suffix(".ivf"))) as source, av.open(str(path), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.is_keyframe and packet.size:
                data = bytes(packet)
                twin = av.Packet(bytes([data[0] & ~0x10]) + data[1:])
                twin.pts, twin.dts, twin.time_base = packet.pts, packet.dts, packet.time_base
                twin.stream, twin.is_keyframe = stream, True
                container.mux(twin)
            if packet.size:
                packet.stream = stream
                retick(packet, 1000)
                packet.pts, packet.dts = packet.pts + late, packet.dts + late
                container.mux(packet)
    return path


def two(folder: Path, ending: str, codec: str, change: Change | None = None, **options: str) -> Path:
    """One recording behind the other."""
    first = write(folder / f"a.{ending}", ALL[:20], codec, **options)
    second = write(folder / f"b.{ending}", ALL[20:], codec, change=change, **options)
    return joined(folder / f"joined.{ending}", first, second)


MAKERS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "bare H.264": (lambda p: write(p / "a.h264", bf="2"), "no times that make sense: 25 a second"),
    "bare H.264, no B": (lambda p: write(p / "a.264", form="h264", bf="0"), "no times that make sense"),
    "bare HEVC": (lambda p: write(p / "a.hevc", codec="libx265"), "no times that make sense: 25 a second"),
    "bare MPEG-4": (lambda p: write(p / "a.m4v", codec="mpeg4", bf="2"), ""),
    "bare MPEG-2": (lambda p: write(p / "a.m2v", codec="mpeg2video", form="mpeg2video", bf="2"), ""),
    "bare MJPEG": (lambda p: write(p / "a.mjpeg", codec="mjpeg"), ""),
    "IVF": (lambda p: write(p / "a.ivf", codec="libvpx"), ""),
    "FLV": (lambda p: write(p / "a.flv", bf="2"), ""),
    "VOB": (lambda p: write(p / "a.vob", codec="mpeg2video", bf="2"), ""),
    "transport stream": (lambda p: write(p / "a.ts", bf="2"), ""),
    "hidden frames, times twice": (lambda p: hidden(p / "a.webm"), ""),
    "hidden frames, times of their own": (lambda p: hidden(p / "a.webm", late=1), ""),
    "hidden frames, mkv": (lambda p: hidden(p / "a.mkv"), ""),
    "a time twice": (
        lambda p: write(p / "a.mkv", change=at(7, by=-40), bf="0"),
        "1 of 40 frames carry no time",
    ),
    "a time three times": (
        lambda p: write(p / "a.mkv", change=at(7, 8, pts=240), bf="0"),
        "2 of 40 frames carry no time",
    ),
    "times twice again and again": (
        lambda p: write(p / "a.mkv", change=at(3, 11, 25, by=-40), bf="0"),
        "of 40 frames carry no time",
    ),
    "a time twice, B": (lambda p: write(p / "a.mkv", change=early(4), bf="2"), "frames carry no time"),
    "no time but one": (lambda p: write(p / "a.mkv", change=always(0), bf="0"), "no times that make sense"),
    "ticks too short": (
        lambda p: write(p / "a.mp4", change=always(0, 1, Fraction(1, 12_800)), bf="0"),
        "no times that make sense",
    ),
    "ticks too long": (
        lambda p: write(p / "a.mp4", change=always(0, 100_000, Fraction(1, 1000)), bf="0"),
        "no times that make sense",
    ),
    "joined transport streams": (
        lambda p: two(p, "ts", "libx264", bf="2"),
        r"jumps or starts again at frame 20: times go on",
    ),
    "joined, MPEG-2": (lambda p: two(p, "ts", "mpeg2video", bf="2"), "starts again at frame 20"),
    "joined, an hour later": (lambda p: two(p, "ts", "libx264", moved(3600)), "jumps or .* at frame 20"),
    "joined, 15 s later": (lambda p: two(p, "ts", "libx264", moved(15)), "jumps or .* at frame 20"),
    "joined, 50 h later": (lambda p: two(p, "ts", "libx264", moved(180_000)), "jumps or .* at frame 20"),
    "joined, half a frame later": (lambda p: two(p, "ts", "libx264", moved(0.02)), "at frame 20"),
    "joined program streams": (
        lambda p: two(p, "vob", "mpeg2video", bf="2"),
        "starts again at frame 20",
    ),
    "joined thrice": (
        lambda p: joined(p / "three.ts", *(write(p / f"{n}.ts", ALL[n : n + 14]) for n in (0, 14, 28))),
        r"at frame 14 and 1 more",
    ),
    "joined, bare": (lambda p: two(p, "h264", "libx264", bf="2"), "no times that make sense"),
}


@pytest.mark.parametrize("kind", MAKERS)
def test_every_frame_comes_in_order_at_even_times_and_what_is_not_believed_is_told(
    kind: str, tmp_path: Path
) -> None:
    make, words = MAKERS[kind]
    looked = look(make(tmp_path))
    assert numbers(looked) == ALL
    assert looked.times[0] == 0
    assert evenly(looked.times)
    assert len(looked.notes) == bool(words)
    assert re.search(words, " ".join(looked.notes))


@pytest.mark.parametrize("kind", MAKERS)
def test_frames_are_found_in_any_order(kind: str, tmp_path: Path) -> None:
    looked = look(MAKERS[kind][0](tmp_path))
    whole = list(read(looked, 0, len(ALL)))
    for n in random.Random(1).sample(ALL, 12):
        np.testing.assert_array_equal(next(read(looked, n, n + 1)), whole[n])


@pytest.mark.parametrize("form", ["ts", "h264"])
def test_a_size_that_changes_is_named_as_that(form: str, tmp_path: Path) -> None:
    large = write(tmp_path / f"a.{form}", ALL[:20])
    small = write(tmp_path / f"b.{form}", ALL[20:], size=(80, 48))
    path = joined(tmp_path / f"joined.{form}", large, small)
    with pytest.raises(
        VideoError,
        match=r"its size changes at frame 20 \(0\.80 s\) from 160 x 90 to 80 x 48; --end 20f stops before it",
    ):
        numbers(look(path))
    assert numbers(look(path, end="20f")) == ALL[:20]


@pytest.mark.parametrize("kind", ["bare H.264", "joined transport streams", "a time twice"])
def test_damage_is_named_where_frames_have_places_instead_of_times(kind: str, tmp_path: Path) -> None:
    path = MAKERS[kind][0](tmp_path)
    data = bytearray(path.read_bytes())
    for place in range(len(data) * 3 // 5, len(data) * 7 // 10):
        data[place] ^= 0x5A
    path.write_bytes(bytes(data))
    with pytest.raises(
        VideoError, match=r"is damaged or cut off: frames 0 to \d+ can be decoded, frame \d+ cannot"
    ):
        look(path)
    looked = look(path, allow_truncated=True)
    assert 10 < len(looked.times) < 40
    assert numbers(looked) == ALL[: len(looked.times)]
    assert evenly(looked.times)


REFRESH = {"x264-params": "intra-refresh=1:keyint=10:bframes=0:scenecut=0:log-level=none"}
CUT: dict[str, tuple[str, int, dict[str, str]]] = {
    "before a key frame": ("libx264", 3, {"bf": "0"}),
    "before a key frame, B": ("libx264", 5, {"bf": "2"}),
    "just behind one": ("libx264", 13, {"bf": "0"}),
    "MPEG-2": ("mpeg2video", 3, {"bf": "0"}),
    "HEVC": ("libx265", 3, {"x265-params": "log-level=none:bframes=0"}),
    "open groups": ("libx264", 3, {"bf": "2", "x264-params": "open-gop=1:log-level=none"}),
    "refreshed bit by bit": ("libx264", 5, REFRESH),
    "refreshed bit by bit, later": ("libx264", 17, REFRESH),
    "refreshed bit by bit, at once": ("libx264", 10, REFRESH),
}
"""Codec, first packet that is left, options."""


@pytest.mark.parametrize("kind", CUT)
def test_what_was_recorded_before_the_first_frame_that_can_be_decoded_is_passed_over_and_counted(
    kind: str, tmp_path: Path
) -> None:
    codec, cut, options = CUT[kind]
    whole = write(tmp_path / "a.ts", ALL, codec, **options)
    assert numbers(look(whole)) == ALL
    with av.open(str(whole)) as source, av.open(str(tmp_path / "late.ts"), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in [p for p in source.demux(video=0) if p.size][cut:]:
            packet.stream = stream
            container.mux(packet)
    with av.open(str(tmp_path / "late.ts")) as container:
        plain = [decoded(frame.to_ndarray(format="bgr24")) for frame in container.decode(video=0)]
    looked = look(tmp_path / "late.ts")
    assert numbers(looked) == plain == ALL[plain[0] :]
    assert looked.times[0] == 0
    assert evenly(looked.times)
    assert len(looked.notes) == 1
    told = re.fullmatch(
        r"its first (\d+) of (\d+) frames cannot be decoded by themselves: they are passed over",
        looked.notes[0],
    )
    assert told
    assert int(told[2]) - int(told[1]) == len(plain)
    for n in (len(plain) - 2, 3, 6):
        assert decoded(next(read(looked, n, n + 1))) == plain[n]


def test_bare_streams_pass_over_what_was_recorded_before_the_first_key_frame_too(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.h264", bf="0").read_bytes()
    with av.open(str(tmp_path / "a.h264")) as container:
        place = [p.pos for p in container.demux(video=0) if p.size][3]
    (tmp_path / "late.h264").write_bytes(whole[place:])
    looked = look(tmp_path / "late.h264")
    assert numbers(looked) == ALL[12:]
    assert any(re.match(r"9 of 37 packets give no frame", note) for note in looked.notes)


@pytest.mark.parametrize(
    ("form", "codec"), [("ts", "mpeg2video"), ("mkv", "mpeg4"), ("ts", "libx264"), ("mkv", "libx264")]
)
def test_a_first_key_frame_that_is_damaged_is_not_passed_over(form: str, codec: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"a.{form}", codec=codec, bf="0")
    with av.open(str(path)) as container:
        begin, end = [p.pos for p in container.demux(video=0) if p.size][:2]
    data = bytearray(path.read_bytes())
    for at in range(end - (end - begin) // 10, end):
        data[at] ^= 0x5A * (form == "mkv" or at % 188 > 30)
    path.write_bytes(bytes(data))
    with pytest.raises(VideoError, match=r"is damaged: its first frame cannot be decoded"):
        look(path)


@pytest.mark.parametrize("form", ["mkv", "mp4"])
def test_pauses_of_a_recording_are_kept(form: str, tmp_path: Path) -> None:
    def paused(n: int, packet: Any) -> None:
        retick(packet, 1000)
        packet.pts = packet.dts = packet.pts + (60_000 if n >= 20 else 0)

    looked = look(write(tmp_path / f"a.{form}", change=paused, bf="0"))
    assert looked.times[20] - looked.times[19] == pytest.approx(60.04)
    assert looked.notes == ()


@pytest.mark.parametrize(
    ("said", "expected", "restarts", "unsaid"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3], [], 0),
        ([7, 8, 10, 11], [0, 1, 3, 4], [], 0),
        ([None, 1, 2, None, 4, None], [0, 1, 2, 3, 4, 5], [], 3),
        ([0, None, None, None, 4, None, None, None, 8], list(range(9)), [], 6),
        ([0, 1, 1, 1, 4], [0, 1, 2, 3, 4], [], 2),
        ([0, 1, 9, 3, 4], [0, 1, 2, 3, 4], [], 1),
        ([5, 6, 1, 8, 9], [0, 1, 2, 3, 4], [], 1),
        ([0, 1, 2, 0, 1, 2], [0, 1, 2, 3, 4, 5], [3], 0),
        ([0, 1, 2, 500, 501, 502], [0, 1, 2, 3, 4, 5], [3], 0),
        ([0, 1, 2, 500, 501, 0, 1], [0, 1, 2, 3, 4, 5, 6], [3, 5], 0),
        ([0, 1, 2, None, 0, 1], [0, 1, 2, 3, 4, 5], [4], 1),
        ([3, 3, 3], [0, 0.04, 0.08], [], 3),
        ([None, None], [0, 0.04], [], 2),
        ([1], [0], [], 1),
        ([-5, -4, -3], [0, 1, 2], [], 0),
    ],
)
def test_times_are_put_right_where_they_are_wrong(
    said: list[float | None], expected: list[float], restarts: list[int], unsaid: int
) -> None:
    clock = settle(said, None, 100)
    assert clock.times == pytest.approx(expected)
    assert (clock.restarts, clock.unsaid) == (restarts, unsaid)


@pytest.mark.parametrize("longest", [10, 108_000])
@pytest.mark.parametrize("jump", [1.05, 1.2, 1.5, 1.9, 1.999, 2.1, 3, 10, -0.5, -1.5, -20])
@pytest.mark.parametrize("lacking", [(), (5,), (6,), (4, 5), (6, 7), (5, 6)])
def test_a_jump_of_any_length_is_one_whatever_frames_beside_it_say_nothing(
    longest: float, jump: float, lacking: tuple[int, ...]
) -> None:
    said = [None if n in lacking else 0.04 * n + jump * longest * (n >= 6) for n in range(12)]
    clock = settle(said, None, longest)
    assert clock.times == pytest.approx([0.04 * n for n in range(12)], abs=1e-6)
    assert clock.restarts == [next(n for n in range(6, 12) if n not in lacking)]
    assert clock.unsaid == len(lacking)


@pytest.mark.parametrize("pause", [0.1, 0.5, 0.99])
@pytest.mark.parametrize("lacking", [(), (5,), (6,), (5, 6)])
def test_a_pause_that_is_no_jump_is_kept_whatever_frames_beside_it_say_nothing(
    pause: float, lacking: tuple[int, ...]
) -> None:
    said = [None if n in lacking else 0.04 * n + 10 * pause * (n >= 6) for n in range(12)]
    clock = settle(said, None, 10)
    assert clock.times[-1] == pytest.approx(0.44 + 10 * pause)
    assert (clock.restarts, clock.unsaid) == ([], len(lacking))


@pytest.mark.parametrize("wrong", [-50, -0.5, 0.3, 5, 15, 500])
def test_one_time_that_is_wrong_is_no_jump(wrong: float) -> None:
    clock = settle([wrong if n == 6 else 0.04 * n for n in range(12)], None, 10)
    assert clock.times == pytest.approx([0.04 * n for n in range(12)])
    assert (clock.restarts, clock.unsaid) == ([], 1)


def test_times_are_always_later_than_those_before_them() -> None:
    draw = random.Random(0)
    for _ in range(300):
        said = [draw.choice([None, draw.uniform(-9, 9), n, n, n]) for n in range(draw.randrange(1, 12))]
        clock = settle(said, Fraction(draw.randrange(1, 60)), 3)
        assert len(clock.times) == len(said)
        assert clock.times[0] == 0
        assert all(b > a for a, b in zip(clock.times, clock.times[1:], strict=False)), said


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("0:01", 25), ("0:00.4", 10), ("00:00:01.2", 30), ("0:0:1", 25), ("1", 25), ("1s", 25), ("1.0", 25), ("25f", 25),
        ("0:00", 0), ("00:01.000", 25), ("0:1", 25),
    ],
)  # fmt: skip
def test_times_are_understood_as_people_write_them(text: str, first: int, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", bf="0")
    assert look(path, start=text).indices[0] == first
    if first:
        assert look(path, end=text).indices[-1] == first - 1


@pytest.mark.parametrize(
    ("text", "seconds"), [("1:02:03.5", 3723.5), ("2:00", 120), ("90:00", 5400), ("29:00:00", 104_400)]
)
def test_hours_and_minutes_count(text: str, seconds: float, tmp_path: Path) -> None:
    def pause(n: int, packet: Any) -> None:
        retick(packet, 1000)
        packet.pts = packet.dts = packet.pts if n < 3 else round(1000 * (seconds + n - 3))

    path = write(tmp_path / "a.mkv", range(6), change=pause, bf="0")
    assert look(path, start=text).indices == (3, 4, 5)
    assert look(path, end=text).indices == (0, 1, 2)


@pytest.mark.parametrize(
    "text", ["soon", "1:75", "1:2:3:4", "-3", "1m30s", "1,5", "00:00:01:12", "1e3", "12.5f", ":30", "0:"]
)
def test_other_times_are_refused_in_words_and_no_pattern_is_shown(text: str) -> None:
    with pytest.raises(SettingsError) as told:
        resolve(overrides={"video.start": text})
    assert str(told.value) == (
        f"settings: video.start = {text!r}: expected seconds (12.5), a time (0:01, 1:02:03.5) or a frame number (300f)"
    )


def test_no_setting_shows_a_pattern() -> None:
    for name in defaults():
        assert not re.search(r"[\\^$]", str(describe(name)["allowed"])), name


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("a.h264", None),
        ("a.mp4", always(0, 1, Fraction(1, 12_800))),
        ("b.mp4", always(0, 100, Fraction(1))),
        ("a.mkv", always(7)),
    ],
)
def test_overlay_and_table_of_a_run_have_times_that_can_be_believed(
    name: str, change: Change | None, tmp_path: Path
) -> None:
    path = write(tmp_path / name, range(6), size=(96, 64), change=change, bf="0")
    segment(path, tmp_path)
    with av.open(str(tmp_path / "out" / name[0] / "overlay.mp4")) as container:
        assert container.streams.video[0].average_rate == 25
        assert sum(1 for _ in container.decode(video=0)) == 6
    rows = (tmp_path / "out" / name[0] / "motion.csv").read_text().splitlines()[1:]
    assert all(float(row.split(",")[2]) == pytest.approx(0.04 * int(row.split(",")[0])) for row in rows)
    assert "make sense: 25 a second are taken" in (tmp_path / "out" / name[0] / "summary.json").read_text()


def test_an_overlay_of_pictures_far_apart_is_shown_in_seconds(tmp_path: Path) -> None:
    for n in range(3):
        (tmp_path / "shot").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "shot" / f"{n}.png"), coded(n, 96, 64))
    segment(tmp_path / "shot", tmp_path, {"video.fps": 0.002})
    with av.open(str(tmp_path / "out/shot/overlay.mp4")) as container:
        assert container.streams.video[0].average_rate == Fraction(1, 10)
