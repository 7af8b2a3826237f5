"""Frames of files, folders and globs: the right ones, in any order; and what is said about bad ones."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.settings import Video
from zsmoseg.sources import fingerprint, sources, stat_signature, unique_names
from zsmoseg.video import Probe, probe, read, read_ignore

COUNT = 40


def coded(number: int, width: int = 160, height: int = 90) -> np.ndarray:
    """A picture that shows its number as six light or dark bars, top to bottom over a ramp."""
    image = np.full((height, width, 3), 40, np.uint8)
    image[:, : width // 4, 2] = 200
    for bit in range(6):
        if number >> bit & 1:
            image[height // 6 * bit : height // 6 * (bit + 1), width // 2 :] = 220
    return image


def decoded(image: np.ndarray) -> int:
    height, width = image.shape[:2]
    bars = [image[height // 6 * b + height // 12, width * 3 // 4].mean() > 128 for b in range(6)]
    return sum(1 << b for b, bar in enumerate(bars) if bar)


def encode(
    path: Path,
    codec: str,
    options: dict[str, str] | None = None,
    pix_fmt: str = "yuv420p",
    size: tuple[int, int] = (160, 90),
    times: list[int] | None = None,
) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options or {})
        stream.width, stream.height, stream.pix_fmt = *size, pix_fmt
        tick = Fraction(1, 1000) if path.suffix != ".avi" else Fraction(1, 25)
        stream.codec_context.time_base = tick
        for n in range(COUNT):
            frame = av.VideoFrame.from_ndarray(coded(n, *size), "bgr24").reformat(format=pix_fmt)
            frame.pts = times[n] if times else int(Fraction(n, 25) / tick)
            frame.time_base = tick
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    return path


VARIABLE = list(np.cumsum([40 + 30 * (n % 3) for n in range(COUNT)]))
CLIPS: dict[str, Callable[[Path], Path]] = {
    "b-frames.mp4": lambda p: encode(p, "libx264", {"bf": "3", "g": "12"}),
    "open-gop.mp4": lambda p: encode(
        p, "libx264", {"x264-params": "open-gop=1:keyint=10:bframes=4:b-adapt=0"}
    ),
    "open-gop.mkv": lambda p: encode(
        p, "libx264", {"x264-params": "open-gop=1:keyint=10:bframes=4:b-adapt=0"}
    ),
    "variable-rate.mp4": lambda p: encode(p, "libx264", {"bf": "2", "g": "15"}, times=VARIABLE),
    "odd-size.mp4": lambda p: encode(p, "libx264", {"bf": "2"}, "yuv444p", (161, 91)),
    "mpeg4.avi": lambda p: encode(p, "mpeg4", {"g": "12", "q": "2"}),
    "mpeg4-b-frames.avi": lambda p: encode(p, "mpeg4", {"g": "12", "bf": "2", "q": "2"}),
    "mpeg4.mov": lambda p: encode(p, "mpeg4", {"g": "12", "bf": "2", "q": "2"}),
    "vp9.webm": lambda p: encode(p, "libvpx-vp9", {"g": "12", "deadline": "realtime", "cpu-used": "8"}),
}


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    for name, make in CLIPS.items():
        make(folder / name)
    return folder


@pytest.mark.parametrize("name", CLIPS)
def test_random_access_gives_the_frames_of_reading_in_order(name: str, clips: Path) -> None:
    looked = probe(str(clips / name), Video())
    assert len(looked.times) == COUNT
    in_order = list(read(looked, 0, COUNT))
    assert [decoded(image) for image in in_order] == list(range(COUNT))
    order = random.Random(0).sample(range(COUNT), COUNT)
    for n in order:
        np.testing.assert_array_equal(next(read(looked, n, n + 1)), in_order[n])
    for start in (33, 5, 17):
        np.testing.assert_array_equal(
            np.stack(list(read(looked, start, start + 6))), in_order[start : start + 6]
        )


def test_times_are_presentation_times(clips: Path) -> None:
    looked = probe(str(clips / "variable-rate.mp4"), Video())
    np.testing.assert_allclose(looked.times, (np.array(VARIABLE) - VARIABLE[0]) / 1000, atol=2e-3)


def test_rotation_is_respected(clips: Path, tmp_path: Path) -> None:
    plain = clips / "b-frames.mp4"
    turned = tmp_path / "turned.mp4"
    data = bytearray(plain.read_bytes())
    one = (1 << 16).to_bytes(4, "big")
    minus = (0xFFFF0000).to_bytes(4, "big")
    zero, w = bytes(4), (1 << 30).to_bytes(4, "big")
    at = data.index(one + zero * 3 + one + zero * 3 + w, data.index(b"tkhd"))
    data[at : at + 36] = zero + one + zero + minus + zero * 4 + w
    turned.write_bytes(bytes(data))
    looked = probe(str(turned), Video())
    assert (looked.width, looked.height) == (90, 160)
    straight = probe(str(plain), Video())
    for n in (0, 17):
        upright = np.rot90(next(read(straight, n, n + 1)), -1)
        np.testing.assert_array_equal(next(read(looked, n, n + 1)), upright)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"start": "10f"}, range(10, 40)),
        ({"end": "7f"}, range(7)),
        ({"start": "0.4", "end": "1.2s"}, range(10, 30)),
        ({"every": 3}, range(0, 40, 3)),
        ({"start": "5f", "end": "25f", "every": 4}, range(5, 25, 4)),
    ],
)
def test_start_end_and_every_choose_frames(limits: dict[str, object], expected: range, clips: Path) -> None:
    looked = probe(str(clips / "open-gop.mp4"), Video(**limits))
    assert [decoded(i) for i in read(looked, 0, len(looked.times))] == list(expected)
    assert looked.names[0] == f"{expected[0]:05d}"


def test_a_probe_goes_through_json(clips: Path) -> None:
    looked = probe(str(clips / "vp9.webm"), Video())
    assert Probe.from_json(json.loads(json.dumps(looked.to_json()))) == looked


# ------------------------------------------------------------------ images
def write(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def test_frames_of_a_folder_come_in_natural_order(tmp_path: Path) -> None:
    for n in (1, 2, 9, 10, 11):
        write(tmp_path / f"frame{n}.png", coded(n))
    looked = probe(str(tmp_path), Video())
    assert [decoded(i) for i in read(looked, 0, 5)] == [1, 2, 9, 10, 11]
    assert looked.names == ("frame1", "frame2", "frame9", "frame10", "frame11")


def test_grey_16_bit_and_alpha_become_8_bit_colour(tmp_path: Path) -> None:
    image = coded(21)
    write(tmp_path / "a.png", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    write(tmp_path / "b.png", image.astype(np.uint16) * 257)
    write(tmp_path / "c.png", np.dstack([image, np.full(image.shape[:2], 9, np.uint8)]))
    a, b, c = read(probe(str(tmp_path), Video()), 0, 3)
    assert decoded(a) == 21
    assert a.shape == image.shape
    np.testing.assert_allclose(b.astype(int), image, atol=1)
    np.testing.assert_array_equal(c, image)


def test_exif_rotation_is_applied(tmp_path: Path) -> None:
    for n in (1, 2):
        exif = Image.Exif()
        exif[0x0112] = 6
        Image.fromarray(coded(n)[..., ::-1]).save(tmp_path / f"{n}.jpg", exif=exif, quality=95)
    looked = probe(str(tmp_path), Video())
    assert (looked.width, looked.height) == (90, 160)
    first = next(read(looked, 0, 1))
    assert decoded(np.rot90(first)) == 1


def test_an_ignore_mask_is_true_where_the_image_is_not_zero(tmp_path: Path) -> None:
    mask = np.zeros((90, 160), np.uint8)
    mask[45:] = 7
    found = read_ignore(str(write(tmp_path / "m.png", mask)), 30, 40)
    assert found[16:].all()
    assert not found[:14].any()


# ------------------------------------------------------------------ sources
def test_files_folders_globs_and_datasets_are_found(clips: Path, tmp_path: Path) -> None:
    for name in ("bear", "goat"):
        for n in range(2):
            write(tmp_path / "davis" / "JPEGImages" / "480p" / name / f"{n:05d}.jpg", coded(n))
    davis = tmp_path / "davis"
    assert [Path(s).name for s in sources([str(davis)])] == ["bear", "goat"]
    assert [Path(s).name for s in sources([str(davis / "JPEGImages" / "480p")])] == ["bear", "goat"]
    assert [Path(s).suffix for s in sources([str(clips / "*.avi")])] == [".avi", ".avi"]
    pattern = str(davis / "JPEGImages" / "480p" / "bear" / "*.jpg")
    assert sources([pattern, pattern]) == [pattern]
    assert unique_names([pattern]) == ["bear"]


def test_names_are_the_shortest_unique_ends(tmp_path: Path) -> None:
    paths = [str(tmp_path / p) for p in ("a/clip.mp4", "b/clip.mp4", "b/other.mp4")]
    assert unique_names(paths) == ["a-clip", "b-clip", "other"]


def test_a_fingerprint_follows_the_content(tmp_path: Path) -> None:
    for n in range(2):
        write(tmp_path / "one" / f"{n}.png", coded(n))
        write(tmp_path / "two" / f"{n}.png", coded(n))
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    assert fingerprint(one, "content") == fingerprint(two, "content")
    before = stat_signature(two)
    write(tmp_path / "two" / "1.png", coded(5))
    assert fingerprint(one, "content") != fingerprint(two, "content")
    assert stat_signature(two) != before


# ------------------------------------------------------------------ what bad input gets
def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"nothing\.mp4: no such file"):
        sources([str(tmp_path / "nothing.mp4")])
    with pytest.raises(VideoError, match="nothing matches"):
        sources([str(tmp_path / "*.mp4")])
    with pytest.raises(VideoError, match="holds neither frames nor videos"):
        sources([str(tmp_path)])


def test_two_sources_that_cannot_be_told_apart_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"clip\.avi and .*clip\.mp4 have one name|have one name"):
        unique_names([str(tmp_path / "clip.mp4"), str(tmp_path / "clip.avi")])


def test_a_file_that_is_no_video_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.mp4").write_text("this is not a video " * 100)
    with pytest.raises(VideoError, match=r"notes\.mp4: is not a video"):
        probe(str(tmp_path / "notes.mp4"), Video())


@pytest.mark.parametrize("name", ["b-frames.mp4", "mpeg4.avi", "vp9.webm", "open-gop.mkv"])
def test_a_truncated_video_names_the_first_bad_frame_and_can_be_used_up_to_it(
    name: str, clips: Path, tmp_path: Path
) -> None:
    path = tmp_path / name
    whole = (clips / name).read_bytes()
    if name.endswith("mp4"):
        at = whole.index(b"mdat")
        size = int.from_bytes(whole[at - 4 : at], "big")
        middle = at + size // 2
        end = at - 4 + size
        path.write_bytes(whole[:middle] + bytes(end - middle) + whole[end:])
    else:
        path.write_bytes(whole[: len(whole) * 3 // 5])
    with pytest.raises(
        VideoError, match=rf"{name}: is damaged or cut off: .* frame \d+ cannot; --allow-truncated"
    ):
        probe(str(path), Video())
    looked = probe(str(path), Video(allow_truncated=True))
    images = list(read(looked, 0, len(looked.times)))
    assert 2 < len(images) < COUNT
    assert [decoded(i) for i in images] == list(range(len(images)))


def test_one_frame_is_too_few(tmp_path: Path) -> None:
    write(tmp_path / "0.png", coded(0))
    with pytest.raises(VideoError, match="motion needs two at least"):
        probe(str(tmp_path), Video())


def test_frames_of_different_sizes_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "0.png", coded(0))
    write(tmp_path / "1.png", coded(1, 80, 48))
    with pytest.raises(VideoError, match=r"1\.png: is 80 x 48, 0\.png is 160 x 90"):
        probe(str(tmp_path), Video())


def test_an_unreadable_image_is_named(tmp_path: Path) -> None:
    for n in range(3):
        write(tmp_path / f"{n}.jpg", coded(n))
    (tmp_path / "1.jpg").write_bytes(b"nothing")
    with pytest.raises(VideoError, match=r"1\.jpg: cannot be read as an image"):
        probe(str(tmp_path), Video())


def test_a_start_behind_the_end_names_the_length(clips: Path) -> None:
    with pytest.raises(SettingsError, match=r"leave 0 of its 40 frames \(1\.56 s\)"):
        probe(str(clips / "b-frames.mp4"), Video(start="99"))


def test_reading_in_order_decodes_each_frame_once(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from zsmoseg import decoding

    starts = []
    start = decoding.Decoder._start
    monkeypatch.setattr(decoding.Decoder, "_start", lambda self, key: (starts.append(key), start(self, key)))
    decoding.decoder.cache_clear()
    looked = probe(str(clips / "b-frames.mp4"), Video())
    starts.clear()
    for first in range(0, COUNT, 8):
        assert [decoded(i) for i in read(looked, first, first + 8)] == list(range(first, first + 8))
    assert len(starts) <= 1 + len(looked.keys)
