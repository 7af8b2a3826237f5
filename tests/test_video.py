"""Frames of files, folders and globs: the right ones, in any order; and what is said about bad ones."""

from __future__ import annotations

import itertools
import json
import pickle
import random
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from coded import coded, decoded, excerpt
from PIL import Image, ImageOps

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.video.frames import read
from zsmoseg.video.ignore import read_ignore
from zsmoseg.video.probe import Probe, probe
from zsmoseg.video.sources import fingerprint, natural, sources, stat_signature, unique_names

COUNT = 40


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
        tick = Fraction(1, 1000) if path.suffix not in (".avi", ".mpg") else Fraction(1, 25)
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
    "mjpeg.avi": lambda p: encode(p, "mjpeg", pix_fmt="yuvj420p"),
    "mpeg2.mpg": lambda p: encode(p, "mpeg2video", {"g": "12", "bf": "2"}),
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
    looked = probe(str(clips / name), excerpt())
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
    looked = probe(str(clips / "variable-rate.mp4"), excerpt())
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
    looked = probe(str(turned), excerpt())
    assert (looked.width, looked.height) == (90, 160)
    straight = probe(str(plain), excerpt())
    for n in (0, 17):
        upright = np.rot90(next(read(straight, n, n + 1)), -1)
        np.testing.assert_array_equal(next(read(looked, n, n + 1)), upright)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turns", range(4))
def test_display_matrices_turn_and_mirror(turns: int, mirrored: bool, tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = 160, 90, "yuv420p"
        stream.set_display_rotation(90 * turns, hflip=mirrored)
        for n in (5, 6):
            for packet in stream.encode(av.VideoFrame.from_ndarray(coded(n), "bgr24")):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    looked = probe(str(tmp_path / "a.mp4"), excerpt())
    with av.open(str(tmp_path / "a.mp4")) as container:
        upright = next(container.decode(video=0)).to_ndarray(format="bgr24")
    upright = upright[:, ::-1] if mirrored and turns % 2 == 0 else upright[::-1] if mirrored else upright
    first = next(read(looked, 0, 1))
    assert first.shape[:2] == (looked.height, looked.width)
    np.testing.assert_array_equal(first, np.rot90(upright, turns))


def test_a_file_that_took_the_place_of_another_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    encode(path, "mjpeg", pix_fmt="yuvj420p")
    assert decoded(next(read(probe(str(path), excerpt()), 3, 4))) == 3
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 90, "yuvj420p"
        for _ in range(COUNT):
            for packet in stream.encode(av.VideoFrame.from_ndarray(coded(63), "bgr24")):
                container.mux(packet)
    assert decoded(next(read(probe(str(path), excerpt()), 4, 5))) == 63


@pytest.mark.parametrize("name", ["mjpeg.avi", "mpeg4.avi", "b-frames.mp4", "vp9.webm"])
def test_a_look_at_a_video_does_not_decode_it_all(
    name: str, clips: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.video import decoding

    count = []
    picture = decoding._picture
    monkeypatch.setattr(decoding, "_picture", lambda frame: (count.append(1), picture(frame))[1])
    probe(str(clips / name), excerpt())
    assert len(count) <= 13


def test_a_last_frame_that_is_shown_long_is_no_damage(tmp_path: Path) -> None:
    times = [40 * n for n in range(COUNT - 1)] + [40 * COUNT + 4000]
    for name, codec in (("a.mp4", "libx264"), ("a.mkv", "libx264")):
        encode(tmp_path / name, codec, times=times)
        assert len(probe(str(tmp_path / name), excerpt()).times) == COUNT


def test_a_trimmed_video_shows_what_its_edit_list_leaves(clips: Path, tmp_path: Path) -> None:
    data = bytearray((clips / "b-frames.mp4").read_bytes())
    at = data.index(b"elst") + 4
    version, entries = data[at], int.from_bytes(data[at + 4 : at + 8], "big")
    assert (version, entries) == (0, 1)
    duration, start = (int.from_bytes(data[at + o : at + o + 4], "big") for o in (8, 12))
    data[at + 8 : at + 12] = (duration // 2).to_bytes(4, "big")
    data[at + 12 : at + 16] = (start + 5 * 640).to_bytes(4, "big")
    (tmp_path / "trimmed.mp4").write_bytes(bytes(data))
    looked = probe(str(tmp_path / "trimmed.mp4"), excerpt())
    shown = [decoded(i) for i in read(looked, 0, len(looked.times))]
    assert shown == list(range(5, 5 + len(shown)))
    assert 18 <= len(shown) <= 25
    for n in (len(shown) - 1, 7, 0):
        assert decoded(next(read(looked, n, n + 1))) == shown[n]


@pytest.mark.parametrize("name", ["b-frames.mp4", "open-gop.mkv", "mpeg4.avi", "mpeg4.mov"])
def test_damage_in_the_middle_never_gives_a_wrong_frame(name: str, clips: Path, tmp_path: Path) -> None:
    with av.open(str(clips / name)) as container:
        packets = [(p.pos, p.size) for p in container.demux(video=0) if p.size]
    data = bytearray((clips / name).read_bytes())
    place, size = packets[20]
    for i in range(place + size // 2, place + size):
        data[i] ^= 0x5A
    path = tmp_path / name
    path.write_bytes(bytes(data))
    images = list(read(probe(str(clips / name), excerpt()), 0, COUNT))
    good, said = read_up_to_damage(str(path))
    assert f"{name}: is damaged or cut off" in said or "cannot be decoded; --end" in said
    looked = probe(str(path), excerpt(allow_truncated=True))
    allowed = list(read(looked, 0, len(looked.times)))
    assert 15 <= len(allowed) < 25
    assert len(good) in (0, len(allowed))
    np.testing.assert_array_equal(allowed, images[: len(allowed)])
    np.testing.assert_array_equal(good, images[: len(good)] or np.empty(0))


def read_up_to_damage(path: str) -> tuple[list[np.ndarray], str]:
    """Frames in order up to the error, and what it says."""
    good = []
    try:
        for image in read(probe(path, excerpt()), 0, COUNT):
            good.append(image)
    except VideoError as error:
        return good, str(error)
    return good, ""


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
    looked = probe(str(clips / "open-gop.mp4"), excerpt(**limits))
    assert [decoded(i) for i in read(looked, 0, len(looked.times))] == list(expected)
    assert looked.indices == tuple(expected)
    assert looked.names == tuple(f"{n:05d}" for n in expected)


def test_a_probe_goes_through_json(clips: Path) -> None:
    looked = probe(str(clips / "vp9.webm"), excerpt())
    assert Probe.from_json(json.loads(json.dumps(looked.to_json()))) == looked
    assert pickle.loads(pickle.dumps(looked)) == looked


def test_a_probe_is_read_from_any_folder(
    clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for n in (3, 4):
        write(tmp_path / "frames" / f"{n}.png", coded(n))
    (tmp_path / "clip.mp4").write_bytes((clips / "b-frames.mp4").read_bytes())
    monkeypatch.chdir(tmp_path)
    found = {name: probe(name, excerpt()) for name in ("frames", "frames/*.png", "clip.mp4")}
    monkeypatch.chdir(tmp_path.parent)
    assert {name: decoded(next(read(p, 1, 2))) for name, p in found.items()} == {
        "frames": 4,
        "frames/*.png": 4,
        "clip.mp4": 1,
    }
    assert [bool(p.files) for p in found.values()] == [True, True, False], "two of images, one a file"


# ------------------------------------------------------------------ images
def write(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def test_frames_of_a_folder_come_in_natural_order(tmp_path: Path) -> None:
    for n in (1, 2, 9, 10, 11):
        write(tmp_path / f"frame{n}.png", coded(n))
    looked = probe(str(tmp_path), excerpt())
    assert [decoded(i) for i in read(looked, 0, 5)] == [1, 2, 9, 10, 11]
    assert looked.names == ("frame1", "frame2", "frame9", "frame10", "frame11")


def test_grey_16_bit_and_alpha_become_8_bit_colour(tmp_path: Path) -> None:
    image = coded(21)
    image[:, :80, 1] = np.arange(80)
    write(tmp_path / "a.png", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    write(tmp_path / "b.png", image.astype(np.uint16) * 257)
    write(tmp_path / "c.png", np.dstack([image, np.full(image.shape[:2], 9, np.uint8)]))
    a, b, c = read(probe(str(tmp_path), excerpt()), 0, 3)
    assert decoded(a) == 21
    assert a.shape == image.shape
    np.testing.assert_array_equal(b, image)
    np.testing.assert_array_equal(c, image)


def test_16_bit_is_divided_by_257_and_rounded(tmp_path: Path) -> None:
    values = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    for n in range(2):
        write(tmp_path / f"{n}.png", values)
    first = next(read(probe(str(tmp_path), excerpt()), 0, 1))
    np.testing.assert_array_equal(first[..., 0], np.rint(values / 257).astype(np.uint8))


def test_palette_two_levels_and_grey_with_alpha_are_read(tmp_path: Path) -> None:
    image = Image.fromarray(coded(21)[..., ::-1].copy())
    image.quantize(16).save(tmp_path / "0.png")
    Image.fromarray(coded(21)[..., 0] > 128).save(tmp_path / "1.png")
    image.convert("LA").save(tmp_path / "2.png")
    assert [decoded(i) for i in read(probe(str(tmp_path), excerpt()), 0, 3)] == [21] * 3


@pytest.mark.parametrize("kind", ["jpg", "png", "tif", "webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(kind: str, orientation: int, tmp_path: Path) -> None:
    for n in (1, 2):
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.fromarray(coded(n)[..., ::-1].copy()).save(tmp_path / f"{n}.{kind}", exif=exif, quality=95)
    looked = probe(str(tmp_path), excerpt())
    assert (looked.width, looked.height) == ((160, 90) if orientation < 5 else (90, 160))
    with Image.open(tmp_path / f"1.{kind}") as image:
        upright = np.asarray(ImageOps.exif_transpose(image).convert("RGB"))[..., ::-1]
    first = next(read(looked, 0, 1))
    assert np.abs(first.astype(int) - upright).mean() < 4


def test_an_ignore_mask_is_true_where_the_image_is_not_zero(tmp_path: Path) -> None:
    for n, mask in enumerate(
        (
            np.full((90, 160), 7, np.uint8),
            np.full((90, 160), 1, np.uint16),
            np.dstack([np.full((90, 160), 1, np.uint8), np.zeros((90, 160, 2), np.uint8)]),
            np.dstack([np.full((90, 160, 3), 255, np.uint8), np.full((90, 160), 255, np.uint8)]),
        )
    ):
        mask[:45, :, ...] = 255 if mask.shape[2:] == (4,) else 0
        if mask.shape[2:] == (4,):
            mask[:45, :, :3] = 0
        path = str(write(tmp_path / f"{n}.png", mask))
        found = read_ignore(path, 90, 160)
        assert found[45:].all()
        assert not found[:45].any()
        small = read_ignore(path, 30, 40)
        assert small.shape == (30, 40)
        assert small[16:].all()
        assert not small[:14].any()


def test_an_ignore_mask_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(b"nothing")
    for name in ("m.png", "none.png"):
        with pytest.raises(SettingsError, match=rf"{name}: the ignore mask cannot be read"):
            read_ignore(str(tmp_path / name), 9, 16)


# ------------------------------------------------------------------ sources
def test_files_folders_globs_and_datasets_are_found(clips: Path, tmp_path: Path) -> None:
    for name in ("bear", "goat"):
        for n in range(2):
            write(tmp_path / "davis" / "JPEGImages" / "480p" / name / f"{n:05d}.jpg", coded(n))
    davis = tmp_path / "davis"
    assert [Path(s).name for s in sources([str(davis)])] == ["bear", "goat"]
    assert [Path(s).name for s in sources([str(davis / "JPEGImages" / "480p")])] == ["bear", "goat"]
    assert [Path(s).suffix for s in sources([str(clips / "*.avi")])] == [".avi"] * 3
    pattern = str(davis / "JPEGImages" / "480p" / "bear" / "*.jpg")
    assert sources([pattern, pattern]) == [pattern]
    assert unique_names([pattern]) == ["bear"]


def test_the_same_source_is_used_once_and_the_order_is_kept(clips: Path, tmp_path: Path) -> None:
    for n in range(2):
        write(tmp_path / "f" / f"{n}.png", coded(n))
    a, b = str(clips / "mpeg4.avi"), str(clips / "vp9.webm")
    assert sources([a, b, a]) == [a, b]
    assert sources([str(tmp_path / "f"), str(tmp_path / "f" / "*.png")]) == [str(tmp_path / "f")]


def test_a_pattern_leaves_out_what_is_no_video(clips: Path, tmp_path: Path) -> None:
    for name in ("b.avi", "a.avi"):
        (tmp_path / name).write_bytes((clips / "mpeg4.avi").read_bytes())
    (tmp_path / "notes.txt").write_text("notes")
    assert [Path(s).name for s in sources([str(tmp_path / "*")])] == ["a.avi", "b.avi"]
    with pytest.raises(VideoError, match="none is a video or an image"):
        sources([str(tmp_path / "*.txt")])


def test_names_that_differ_by_zeros_have_an_order() -> None:
    names = ["²3", "f001.png", "f01.png", "f1.png"]
    for order in itertools.permutations(names):
        assert sorted(order, key=natural) == sorted(names, key=natural)


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
        probe(str(tmp_path / "notes.mp4"), excerpt())


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
        probe(str(path), excerpt())
    looked = probe(str(path), excerpt(allow_truncated=True))
    images = list(read(looked, 0, len(looked.times)))
    assert 2 < len(images) < COUNT
    assert [decoded(i) for i in images] == list(range(len(images)))


def test_one_frame_is_too_few(tmp_path: Path) -> None:
    write(tmp_path / "0.png", coded(0))
    with pytest.raises(VideoError, match="motion needs two at least"):
        probe(str(tmp_path), excerpt())


def test_frames_of_different_sizes_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "0.png", coded(0))
    write(tmp_path / "1.png", coded(1, 80, 48))
    with pytest.raises(VideoError, match=r"1\.png: is 80 x 48, 0\.png is 160 x 90"):
        probe(str(tmp_path), excerpt())


def test_an_unreadable_image_is_named(tmp_path: Path) -> None:
    for n in range(3):
        write(tmp_path / f"{n}.jpg", coded(n))
    (tmp_path / "1.jpg").write_bytes(b"nothing")
    with pytest.raises(VideoError, match=r"1\.jpg: cannot be read as an image"):
        probe(str(tmp_path), excerpt())


@pytest.mark.parametrize("kind", ["jpg", "png", "bmp", "webp"])
def test_an_image_that_is_cut_off_is_named_at_the_latest_when_it_is_read(kind: str, tmp_path: Path) -> None:
    for n in range(3):
        write(tmp_path / f"{n}.{kind}", coded(n))
    whole = (tmp_path / f"1.{kind}").read_bytes()
    (tmp_path / f"1.{kind}").write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(VideoError, match=rf"1\.{kind}: cannot be read as an image"):
        list(read(probe(str(tmp_path), excerpt()), 0, 3))


def test_pixels_that_are_no_8_or_16_bit_are_refused(tmp_path: Path) -> None:
    for n in range(2):
        write(tmp_path / f"{n}.tif", coded(n).astype(np.float32) / 255)
    with pytest.raises(VideoError, match=r"0\.tif: .*; replace it or take it out"):
        next(read(probe(str(tmp_path), excerpt()), 0, 1))


def test_an_image_that_vanished_or_changed_its_size_is_named(tmp_path: Path) -> None:
    for n in range(2):
        write(tmp_path / f"{n}.png", coded(n))
    looked = probe(str(tmp_path), excerpt())
    write(tmp_path / "0.png", coded(0, 80, 48))
    (tmp_path / "1.png").unlink()
    with pytest.raises(VideoError, match=r"0\.png: is 80 x 48, expected 160 x 90"):
        next(read(looked, 0, 1))
    with pytest.raises(VideoError, match=r"1\.png: cannot be read \(No such file"):
        next(read(looked, 1, 2))


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"holds no frames; give a folder of images"):
        probe(str(tmp_path), excerpt())


def test_a_source_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"none\.mp4: no such file or folder"):
        probe(str(tmp_path / "none.mp4"), excerpt())


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"start": "99"}, r"video\.start = 99 is behind its 40 frames \(0 to 1\.56 s\)"),
        ({"start": "40f"}, r"video\.start = 40f is behind its 40 frames"),
        ({"start": "20f", "end": "0.2"}, r"video\.start = 20f is not before video\.end = 0\.2"),
        ({"every": 40}, r"leave one of its 40 frames"),
        ({"start": "39f"}, r"leave one of its 40 frames"),
    ],
)
def test_limits_that_leave_no_two_frames_name_the_length(
    limits: dict[str, object], words: str, clips: Path
) -> None:
    with pytest.raises(VideoError, match=words):
        probe(str(clips / "b-frames.mp4"), excerpt(**limits))


def test_an_end_behind_the_last_frame_is_the_last_frame(clips: Path) -> None:
    assert len(probe(str(clips / "b-frames.mp4"), excerpt(end="1000f")).times) == COUNT


def test_reading_in_order_decodes_each_frame_once(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from zsmoseg.video import decoding

    starts = []
    start = decoding.Decoder._start
    monkeypatch.setattr(decoding.Decoder, "_start", lambda self, *at: (starts.append(at), start(self, *at)))
    vars(decoding._KEPT).clear()
    looked = probe(str(clips / "b-frames.mp4"), excerpt())
    starts.clear()
    for first in range(0, COUNT, 8):
        assert [decoded(i) for i in read(looked, first, first + 8)] == list(range(first, first + 8))
    assert len(starts) == 1


def test_names_keep_their_hyphens(tmp_path: Path) -> None:
    assert unique_names([str(tmp_path / "scooter-black"), str(tmp_path / "a b.mp4")]) == [
        "scooter-black",
        "a_b",
    ]
