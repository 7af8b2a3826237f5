"""Containers with more than one stream, and headers that say nothing or too much: which video is meant, and how long it is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from av.stream import Disposition
from coded import add, coded, decoded, look, numbers, write
from PIL import Image

from zsmoseg.errors import VideoError
from zsmoseg.video.frames import read
from zsmoseg.video.pixels import pixels

ALL, OTHER = list(range(40)), [63] * 40


def box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", len(body) + 8, kind) + body


def boxes(data: bytes) -> list[tuple[bytes, bytes]]:
    at, found = 0, []
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        found.append((kind, data[at + 8 : at + size]))
        at += size
    return found


def with_cover(path: Path) -> Path:
    """As taggers write it: the picture stands before the tracks."""
    write(path)
    jpeg = cv2.imencode(".jpg", coded(63, 300, 300))[1].tobytes()
    covr = box(b"covr", box(b"data", struct.pack(">II", 13, 0) + jpeg))
    hdlr = box(b"hdlr", bytes(8) + b"mdirappl" + bytes(9))
    udta = box(b"udta", box(b"meta", bytes(4) + hdlr + box(b"ilst", covr)))
    data = b""
    for kind, body in boxes(path.read_bytes()):
        first = struct.unpack(">I", body[:4])[0] if kind == b"moov" else 0
        data += box(kind, body[:first] + udta + body[first:] if kind == b"moov" else body)
    path.write_bytes(data)
    return path


def several(path: Path, *streams: tuple[list[int], tuple[int, int], int], sound: bool = False) -> Path:
    """Streams of pictures, sizes and dispositions; a picture alone is a JPEG."""
    with av.open(str(path), "w") as container:
        heard = _sound(container, "aac") if sound else None
        made = []
        for shown, size, disposition in streams:
            stream = container.add_stream("libx264" if len(shown) > 1 else "mjpeg", rate=25)
            stream.width, stream.height, stream.pix_fmt = *size, "yuv420p" if len(shown) > 1 else "yuvj420p"
            stream.disposition = Disposition(disposition)
            made.append((stream, shown, size))
        for stream, shown, size in made:
            for n in shown:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(coded(n, *size), "bgr24")))
            container.mux(stream.encode(None))
        if heard is not None:
            _silence(container, heard)
    return path


def _sound(container: Any, codec: str) -> Any:
    return container.add_stream(codec, rate=16_000, layout="mono")


def _silence(container: Any, stream: Any, seconds: int = 4) -> None:
    context = stream.codec_context
    length, form = context.frame_size or 1024, context.format.name
    kind = {"flt": np.float32, "s32": np.int32, "s16": np.int16}[form.removesuffix("p")]
    for n in range(seconds * 16_000 // length):
        frame = av.AudioFrame.from_ndarray(np.zeros((1, length), kind), form, "mono")
        frame.sample_rate, frame.pts = 16_000, n * length
        container.mux(stream.encode(frame))
    container.mux(stream.encode(None))


def heard(path: Path, codec: str = "aac") -> Path:
    """Sound alone."""
    with av.open(str(path), "w") as container:
        _silence(container, _sound(container, codec))
    return path


NONE, DEFAULT, COVER = 0, Disposition.default, Disposition.attached_pic
LARGE, SMALL = (160, 90), (80, 48)
STREAMS: dict[str, Callable[[Path], Path]] = {
    "cover before the video": lambda p: with_cover(p / "a.mp4"),
    "cover as a stream": lambda p: several(p / "a.mp4", ([63], LARGE, COVER), (ALL, LARGE, NONE)),
    "a picture that is not marked": lambda p: several(
        p / "a.mkv", ([63], LARGE, DEFAULT), (ALL, LARGE, NONE)
    ),
    "a preview": lambda p: several(p / "a.mkv", (OTHER[:9], SMALL, NONE), (ALL, LARGE, NONE)),
    "a preview, all default": lambda p: several(
        p / "a.mkv", (OTHER[:9], SMALL, DEFAULT), (ALL, LARGE, DEFAULT)
    ),
    "a preview as long": lambda p: several(p / "a.mkv", (OTHER, SMALL, DEFAULT), (ALL, LARGE, DEFAULT)),
    "the default": lambda p: several(p / "a.mkv", (OTHER * 2, LARGE, NONE), (ALL, LARGE, DEFAULT)),
    "the default, first": lambda p: several(p / "a.mkv", (ALL, SMALL, DEFAULT), (OTHER * 2, LARGE, NONE)),
    "two alike": lambda p: several(p / "a.mkv", (ALL, LARGE, NONE), (OTHER, LARGE, NONE)),
    "longer sound": lambda p: several(p / "a.mkv", (ALL, LARGE, NONE), sound=True),
    "longer sound, mp4": lambda p: several(p / "a.mp4", (ALL, LARGE, NONE), sound=True),
    "two programmes": lambda p: several(p / "a.ts", (OTHER[:9], SMALL, NONE), (ALL, LARGE, NONE), sound=True),
}


@pytest.mark.parametrize("kind", STREAMS)
def test_the_video_is_the_default_else_the_longest_stream_and_never_a_picture(
    kind: str, tmp_path: Path
) -> None:
    looked = look(STREAMS[kind](tmp_path))
    assert numbers(looked) == ALL
    assert looked.times[1] == pytest.approx(0.04, abs=1e-3)
    assert looked.notes == ()


@pytest.mark.parametrize(
    ("ending", "codec"),
    [
        ("m4a", "aac"),
        ("mkv", "aac"),
        ("mp4", "aac"),
        ("aac", "aac"),
        ("ts", "aac"),
        ("wav", "pcm_s16le"),
        ("flac", "flac"),
        ("mp3", "libmp3lame"),
    ],
)
def test_sound_alone_has_no_video(ending: str, codec: str, tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=rf"a\.{ending}: has no video, only sound$"):
        look(heard(tmp_path / f"a.{ending}", codec))


def test_sound_with_a_cover_has_no_video(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"has no video, only sound and a picture of it$"):
        look(several(tmp_path / "a.mp4", ([63], LARGE, COVER), sound=True))


# ---------------------------------------------------------------------- how long it is
def tagged(path: Path, tag: bytes) -> Path:
    """Matroska with this in place of the duration that the tag of the stream has."""
    data = write(path, bf="0").read_bytes()
    at = data.index(b"00:00:01.6000")
    path.write_bytes(data[:at] + tag.ljust(18, b"\0")[:18] + data[at + 18 :])
    return path


@pytest.mark.parametrize(
    "tag",
    ["00:04:02.000000000", "2 s", "", "00:00:02,000000000", "PT1.6S", "-1:00:00", "nan:nan:nan", "inf:0:0", "1:2:3:4", "0:0:0",
     "00:00:00.100", "\u0661:0:0", "1e400:0:0"],
)  # fmt: skip
def test_a_duration_that_is_no_number_or_not_true_changes_nothing(tag: str, tmp_path: Path) -> None:
    looked = look(tagged(tmp_path / "a.mkv", tag.encode()))
    assert numbers(looked) == ALL
    assert looked.notes == ()


def longer(path: Path, *names: bytes) -> Path:
    """MP4 whose header says ten times the time."""
    data = bytearray(write(path, bf="0").read_bytes())
    for name in names:
        at = data.index(name) + (24 if name == b"tkhd" else 20)
        data[at : at + 4] = (10 * int.from_bytes(data[at : at + 4], "big")).to_bytes(4, "big")
    path.write_bytes(bytes(data))
    return path


@pytest.mark.parametrize("names", [[b"mdhd"], [b"mvhd"], [b"mdhd", b"mvhd", b"tkhd"]])
def test_an_mp4_that_promises_more_is_whole(names: list[bytes], tmp_path: Path) -> None:
    assert numbers(look(longer(tmp_path / "a.mp4", *names))) == ALL


def test_a_header_that_promises_more_than_the_packets_is_told_and_not_believed(tmp_path: Path) -> None:
    path = tagged(tmp_path / "a.mkv", b"00:04:02.000000000")
    data = path.read_bytes()
    at = data.index(b"\x44\x89\x88") + 3
    assert struct.unpack(">d", data[at : at + 8]) == (1600.0,)
    path.write_bytes(data[:at] + struct.pack(">d", 90_000) + data[at + 8 :])
    looked = look(path)
    assert numbers(looked) == ALL
    assert looked.notes == ("its header promises 88.40 s more than there are: what is there is taken",)


def test_an_avi_that_promises_more_frames_is_whole(tmp_path: Path) -> None:
    data = bytearray(write(tmp_path / "a.avi", codec="mjpeg").read_bytes())
    at = data.index(b"strh") + 8 + 32
    assert int.from_bytes(data[at : at + 4], "little") == 40
    data[at : at + 4] = (4000).to_bytes(4, "little")
    (tmp_path / "a.avi").write_bytes(bytes(data))
    assert numbers(look(tmp_path / "a.avi")) == ALL


@pytest.mark.parametrize(
    ("ending", "codec"), [("mkv", "libx264"), ("webm", "libvpx"), ("avi", "mpeg4"), ("mp4", "libx264")]
)
def test_a_file_that_lacks_its_end_is_told_from_one_that_promised_too_much(
    ending: str, codec: str, tmp_path: Path
) -> None:
    path = tmp_path / f"a.{ending}"
    with av.open(str(path), "w", options={"movflags": "faststart"} if ending == "mp4" else {}) as container:
        add(container, ALL, codec, bf="0")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 7 // 10])
    with pytest.raises(
        VideoError, match=r"is damaged or cut off: frames 0 to \d+ can be decoded, frame \d+ cannot"
    ):
        look(path)
    looked = look(path, allow_truncated=True)
    assert numbers(looked) == ALL[: len(looked.times)]
    assert 10 < len(looked.times) < 40


class Pipe:
    """A file to which nobody comes back, to write how long it became."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("wb")

    def write(self, data: bytes) -> int:
        return self.file.write(data)


PIPED = [("avi", "mpeg4", {}), ("avi", "mjpeg", {}), ("matroska", "libx264", {}), ("matroska", "libx264", {"live": "1"}),
         ("webm", "libvpx", {}), ("mp4", "libx264", {"movflags": "frag_keyframe+empty_moov"}), ("flv", "libx264", {}), ("asf", "mpeg4", {}),
         ("nut", "libx264", {})]  # fmt: skip


@pytest.mark.parametrize(("form", "codec", "options"), PIPED)
def test_what_was_written_to_a_pipe_is_whole(
    form: str, codec: str, options: dict[str, str], tmp_path: Path
) -> None:
    pipe = Pipe(tmp_path / "a")
    with pipe.file, av.open(pipe, "w", format=form, options=options) as container:
        add(container, ALL, codec, bf="0")
    looked = look(tmp_path / "a")
    assert numbers(looked) == ALL
    assert looked.notes == ()


@pytest.mark.parametrize(
    ("name", "place", "by", "size"),
    [("a.avi", b"RIFF", 4, bytes(4)), ("a.avi", b"RIFF", 4, b"\xff" * 4), ("a.mp4", b"mdat", -4, bytes(4))],
)
def test_a_size_that_is_not_known_is_no_sign_of_a_cut(
    name: str, place: bytes, by: int, size: bytes, tmp_path: Path
) -> None:
    with av.open(str(tmp_path / name), "w", format=name[2:], options={"movflags": "faststart"}) as container:
        add(container, ALL, "mpeg4", bf="0")
    data = bytearray((tmp_path / name).read_bytes())
    at = data.rindex(place) + by
    data[at : at + 4] = size
    (tmp_path / name).write_bytes(bytes(data))
    assert numbers(look(tmp_path / name)) == ALL


# ---------------------------------------------------------------------- what frames carry
def pictures(count: int, orientation: int) -> list[bytes]:
    """JPEGs as cameras write them, which say in their EXIF how they are held."""
    tags, made = Image.Exif(), []
    tags[0x010F], tags[0x0112] = "Maker", orientation
    for n in range(count):
        file = BytesIO()
        Image.fromarray(coded(n)[..., ::-1]).save(file, "JPEG", quality=95, exif=tags)
        made.append(file.getvalue())
    return made


def with_exif(path: Path, orientation: int, count: int = 12) -> Path:
    """The bare pictures, those in an AVI, or an APNG."""
    if path.suffix == ".mjpeg":
        path.write_bytes(b"".join(pictures(count, orientation)))
    elif path.suffix == ".apng":
        first, *rest = [Image.open(BytesIO(data)) for data in pictures(count, orientation)]
        tags = first.getexif()
        first.save(path, "PNG", save_all=True, append_images=rest, duration=40, exif=tags)
    else:
        with av.open(str(path), "w") as container:
            stream = container.add_stream("mjpeg", rate=25)
            stream.width, stream.height, stream.pix_fmt = 160, 90, "yuvj420p"
            for n, data in enumerate(pictures(count, orientation)):
                packet = av.Packet(data)
                packet.stream, packet.pts, packet.dts, packet.is_keyframe = stream, n, n, True
                packet.time_base = Fraction(1, 25)
                container.mux(packet)
    return path


@pytest.mark.parametrize("name", ["a.avi", "a.mkv", "a.mjpeg", "a.apng"])
def test_frames_may_carry_what_nobody_here_knows(name: str, tmp_path: Path) -> None:
    looked = look(with_exif(tmp_path / name, 1))
    assert numbers(looked) == list(range(12))
    for n in (7, 2, 11):
        assert decoded(next(read(looked, n, n + 1))) == n
    assert numbers(look(tmp_path / name, every=5)) == [0, 5, 10]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_of_frames_turns_them_as_it_turns_images(orientation: int, tmp_path: Path) -> None:
    looked = look(with_exif(tmp_path / "a.avi", orientation, count=2))
    (tmp_path / "1.jpg").write_bytes(pictures(2, orientation)[1])
    image = pixels(str(tmp_path / "1.jpg"))
    assert image is not None
    assert (looked.width, looked.height) == image.shape[1::-1]
    assert np.abs(next(read(looked, 1, 2)).astype(int) - image).mean() < 8


# ---------------------------------------------------------------------- what is elsewhere
LISTS = {
    "a.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nvideo.ts\n#EXT-X-ENDLIST\n",
    "live.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nvideo.ts\n",
    "itself.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nitself.m3u8\n#EXT-X-ENDLIST\n",
    "far.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
    "a.ffconcat": "ffconcat version 1.0\nfile video.ts\n",
    "a.mp4": "ffconcat version 1.0\nfile video.ts\n",
    "gone.ffconcat": "ffconcat version 1.0\nfile gone.mp4\n",
    "a.sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n"
    "a=rtpmap:96 H264/90000\n",
}


@pytest.mark.parametrize("name", LISTS)
def test_what_names_other_files_is_refused_and_none_of_them_is_looked_for(name: str, tmp_path: Path) -> None:
    """A change of those would be seen by nobody: they are in no fingerprint."""
    write(tmp_path / "video.ts", range(8))
    (tmp_path / name).write_text(LISTS[name])
    words = rf"{name}: is a list of other files, .*; join them .*\(ffmpeg -i {name} -c copy joined\.mkv\)$"
    with pytest.raises(VideoError, match=words):
        look(tmp_path / name)


@pytest.mark.parametrize("name", ["a.m3u8", "a.mpd", "a.mp4", "a.txt"])
def test_text_that_is_no_list_is_no_video(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("nothing\n" * 9)
    with pytest.raises(VideoError, match="is not a video, or it is damaged from the start"):
        look(tmp_path / name)
