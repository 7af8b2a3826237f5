"""Names and folders as people and their tools leave them: the videos that are meant, each by a name of its own."""

from __future__ import annotations

import os
import shutil
import socket
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from coded import coded, look, numbers, write
from PIL import Image
from runs import masks, segment

from zsmoseg.errors import StageError, VideoError
from zsmoseg.video.sources import fingerprint, sources, stat_signature, unique_names

WILD = [
    "a [b]",
    "a*b",
    "what?",
    "[!a]",
    "[",
    "]",
    "[a-z] 1",
    "{a,b}",
    "a**",
    "take [[]1]",
    "100%",
    "#1 $HOME ~",
]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("clip") / "clip.mp4", range(6))


def frames(
    folder: Path, shown: Iterator[int] | range = range(3), ending: str = "png", name: str = ""
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for n in shown:
        Image.fromarray(coded(n)[..., ::-1].copy()).save(folder / f"{name}{n:04d}.{ending}", quality=95)
    return folder


def found(*given: Path | str) -> list[str]:
    return sources([str(one) for one in given])


def names_of(*given: Path | str) -> list[str]:
    return [Path(one).name for one in found(*given)]


# ---------------------------------------------------------------------- characters of patterns
@pytest.mark.parametrize("name", WILD)
def test_a_name_that_exists_is_no_pattern(name: str, clip: Path, tmp_path: Path) -> None:
    shutil.copy(clip, tmp_path / f"{name}.mp4")
    frames(tmp_path / name)
    frames(tmp_path / f"{name} other", range(5, 9))
    both = found(tmp_path)
    assert both == [str(tmp_path / name), str(tmp_path / f"{name} other"), str(tmp_path / f"{name}.mp4")] or (
        sorted(both) == sorted(map(str, tmp_path.iterdir()))
    )
    assert numbers(look(tmp_path / f"{name}.mp4")) == list(range(6))
    assert numbers(look(tmp_path / name)) == [0, 1, 2]
    for pattern, expected in ((f"{name}/*.png", [0, 1, 2]), (f"{name} other/*", [5, 6, 7, 8])):
        (one,) = found(tmp_path / pattern)
        assert numbers(look(Path(one))) == expected
        assert fingerprint(one, "content") == fingerprint(str((tmp_path / pattern).parent), "content")
        assert stat_signature(one) == stat_signature(str((tmp_path / pattern).parent))
    first, second = unique_names(found(tmp_path / f"{name} other", tmp_path / f"{name}/*.png"))
    assert first == unique_names(found(tmp_path / f"{name} other"))[0]
    assert second == unique_names(found(tmp_path / name))[0]


@pytest.mark.parametrize("name", WILD)
def test_a_pattern_is_read_where_the_user_stands(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames(tmp_path / name / "shot")
    monkeypatch.chdir(tmp_path / name)
    looked = look(Path("shot/*.png"))
    monkeypatch.chdir(tmp_path)
    assert numbers(looked) == [0, 1, 2]
    assert numbers(look(Path(looked.source))) == [0, 1, 2]


@pytest.mark.parametrize(
    ("pattern", "count"), [("take*/*.png", 4), ("**/*.png", 4), ("take [[]*/*", 2), ("take [1-2]/*.png", 2)]
)
def test_a_pattern_of_several_folders_means_a_video_of_each(pattern: str, count: int, tmp_path: Path) -> None:
    for n in (1, 2):
        frames(tmp_path / f"take [{n}]", range(10 * n, 10 * n + 3))
        frames(tmp_path / f"take {n}", range(10 * n + 5, 10 * n + 8))
    some = found(tmp_path / pattern)
    shown = [numbers(look(Path(one))) for one in some]
    assert all(one == list(range(one[0], one[0] + 3)) for one in shown)
    assert len({one[0] for one in shown}) == len(some) == count
    assert len(set(unique_names(some))) == len(some)


# ---------------------------------------------------------------------- what lies beside videos
THUMBNAILS = {
    "of each": ["park.jpg", "street.jpg"],
    "of one": ["park.webp"],
    "with the ending": ["park.mp4.jpg", "street.mp4.jpg"],
    "of the folder": ["folder.jpg", "cover.png", "poster.jpg"],
    "several": [
        "park-thumb.jpg",
        "park-fanart.jpg",
        "park-poster.jpg",
        "street-poster.jpg",
        "street-thumb.jpg",
    ],
    "numbered": ["thumb1.jpg", "thumb2.jpg"],
    "in a folder": ["thumbs/park.jpg", "thumbs/street.jpg"],
    "in a folder, many": [f"thumbs/park_{n}.jpg" for n in range(9)],
    "of Synology": ["@eaDir/park.mp4/SYNOPHOTO_THUMB_M.jpg", "@eaDir/park.mp4/SYNOPHOTO_THUMB_B.jpg"],
    "hidden": [
        "._park.mp4",
        "._park.jpg",
        "._street.jpg",
        "._x.jpg",
        "._y.jpg",
        "._z.jpg",
        "._0.jpg",
        "._1.jpg",
    ],
    "of Jupyter": [".ipynb_checkpoints/a-checkpoint.png", ".ipynb_checkpoints/b-checkpoint.png"],
    "of macOS": ["__MACOSX/a.png", "__MACOSX/b.png", "__MACOSX/._park.mp4", ".DS_Store"],
    "of Windows": ["Thumbs.db", "desktop.ini", "$RECYCLE.BIN/a.jpg", "$RECYCLE.BIN/b.jpg"],
    "subtitles": ["park.srt", "park.info.json", "park.en.vtt"],
}


@pytest.mark.parametrize("kind", THUMBNAILS)
def test_videos_are_run_and_not_the_pictures_of_them(kind: str, clip: Path, tmp_path: Path) -> None:
    folder = tmp_path / "outer" / "inner"
    folder.mkdir(parents=True)
    for name in ("park.mp4", "street.mp4"):
        shutil.copy(clip, folder / name)
    for name in THUMBNAILS[kind]:
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        if name.endswith(("jpg", "png", "webp")) and not name.startswith("._"):
            Image.fromarray(coded(1)).save(folder / name)
        else:
            (folder / name).write_bytes(b"\x00\x05\x16\x07" + bytes(40))
    for given in (folder, folder / "*", folder.parent, folder.parent / "*"):
        assert names_of(given) == ["park.mp4", "street.mp4"]


def test_many_images_beside_a_video_are_asked_about(clip: Path, tmp_path: Path) -> None:
    frames(tmp_path, range(9))
    shutil.copy(clip, tmp_path / "clip.mp4")
    for given in (tmp_path, tmp_path / "*"):
        with pytest.raises(
            VideoError, match=r"holds 9 images beside videos \(1\); give the videos, or a glob"
        ):
            found(given)
    assert numbers(look(Path(found(tmp_path / "*.png")[0]))) == list(range(9))
    assert names_of(tmp_path / "*.mp4") == ["clip.mp4"]


def test_one_picture_beside_folders_of_frames_is_no_video(tmp_path: Path) -> None:
    for name in ("a", "b"):
        frames(tmp_path / name)
    Image.fromarray(coded(1)).save(tmp_path / "overview.jpg")
    assert names_of(tmp_path) == ["a", "b"]


@pytest.mark.parametrize(
    "junk", ["._0001.png", "Thumbs.db", ".ipynb_checkpoints", "__MACOSX", "@eaDir", "notes.txt", "masks"]
)
def test_what_tools_leave_among_frames_is_passed_over(junk: str, tmp_path: Path) -> None:
    frames(tmp_path / "shot")
    if "." in junk[1:]:
        (tmp_path / "shot" / junk).write_bytes(b"nothing")
    else:
        frames(tmp_path / "shot" / junk, range(50, 54))
    assert found(tmp_path / "shot") == [str(tmp_path / "shot")]
    assert numbers(look(tmp_path / "shot")) == [0, 1, 2]
    assert numbers(look(Path(found(tmp_path / "shot" / "*")[0]))) == [0, 1, 2]


# ---------------------------------------------------------------------- one frame twice
TWINS = {
    "another ending": ["{n:04d}.jpg", "{n:04d}.png"],
    "another case": ["{n:04d}.png", "{n:04d}.PNG"],
    "a mask": ["{n:04d}.jpg", "{n:04d}_mask.png"],
    "a mask, in front": ["frame{n}.png", "mask{n}.png"],
    "two eyes": ["left_{n:04d}.png", "right_{n:04d}.png"],
    "numbers and years": ["2024-{n:02d} rgb.png", "2024-{n:02d} gt.png"],
}


@pytest.mark.parametrize("kind", TWINS)
@pytest.mark.parametrize("masked", [6, 4])
def test_a_frame_that_is_there_twice_is_refused(kind: str, masked: int, tmp_path: Path) -> None:
    for pattern, count in zip(TWINS[kind], (6, masked), strict=True):
        for n in range(count):
            Image.fromarray(coded(n)).save(tmp_path / pattern.format(n=n))
    with pytest.raises(
        VideoError, match=r"seem to be one frame, or a frame and its mask; .*glob of the frames"
    ):
        look(Path(found(tmp_path)[0]))
    one = TWINS[kind][0].format(n=0).replace("0000", "*").replace("-00", "-*").replace("0.", "*.")
    assert len(look(Path(found(tmp_path / one)[0])).times) == 6


@pytest.mark.parametrize(
    "names",
    [
        ["a.png", "b.png", "c.png"],
        ["f1.png", "f2.png", "f10.png", "title.png"],
        ["shot1_0001.png", "shot1_0002.png", "shot2_0001.png", "shot2_0002.png"],
        ["0000.png", "0001.png", "0001 copy.png"],
    ],
)
def test_other_names_of_frames_are_taken(names: list[str], tmp_path: Path) -> None:
    for name in names:
        Image.fromarray(coded(1)).save(tmp_path / name)
    assert sorted(look(tmp_path).names) == sorted(Path(name).stem for name in names)


# ---------------------------------------------------------------------- endings and letters
@pytest.mark.parametrize(
    "ending",
    [
        "mp4",
        "MP4",
        "h264",
        "264",
        "hevc",
        "ts",
        "MTS",
        "m2ts",
        "flv",
        "wmv",
        "3gp",
        "mkv",
        "webm",
        "vob",
        "mxf",
        "xyz",
        "dat",
    ],
)
def test_every_ending_is_stripped_alike(ending: str, clip: Path, tmp_path: Path) -> None:
    shutil.copy(clip, tmp_path / f"goat.v2.{ending}")
    assert unique_names(found(tmp_path / f"goat.v2.{ending}")) == ["goat.v2"]
    assert (ending in ("xyz", "dat")) or names_of(tmp_path) == [f"goat.v2.{ending}"]


@pytest.mark.parametrize("name", ["goat.v2", "2024.01.31", "Mr. Smith 1.5"])
def test_folders_and_files_without_ending_keep_their_dots(name: str, clip: Path, tmp_path: Path) -> None:
    assert unique_names([str(frames(tmp_path / "a" / name))]) == [name.replace(" ", "_")]
    (tmp_path / "b").mkdir()
    shutil.copy(clip, tmp_path / "b" / f"{name}.mp4")
    assert unique_names([str(tmp_path / "b" / f"{name}.mp4")]) == [name.replace(" ", "_")]


LETTERS = {
    "CJK": "漢" * 82,
    "Hangul, decomposed": unicodedata.normalize("NFD", "한국어 동영상"),
    "Devanagari": "हिन्दी में",
    "Arabic": "فيديو ٣",
    "emoji": "🎬🦆",
    "a family": "👨\u200d👩\u200d👧 \u2764\ufe0f",
    "full width": "動画！？",
    "controls": "a\tb\u202ec",
    "punctuation": "!!! ???",
    "another encoding": os.fsdecode(b"caf\xe9"),
    "line end": "one\ntwo",
    "dashes": "--out",
}


@pytest.mark.parametrize("kind", LETTERS)
def test_videos_with_any_letters_have_names_of_their_own(kind: str, clip: Path, tmp_path: Path) -> None:
    name = LETTERS[kind]
    for text in (name, f"{name[:-1]}x"):
        shutil.copy(clip, tmp_path / f"{text}.mp4")
        assert numbers(look(tmp_path / f"{text}.mp4")) == list(range(6))
    both = unique_names(found(tmp_path))
    assert len(set(both)) == 2
    assert all(len(os.fsencode(one)) <= 120 and "/" not in one and not one.startswith(".") for one in both)


@pytest.mark.parametrize(("one", "other"), [("!!!", "???"), ("動画！", "動画？"), ("Clip (1)", "Clip [1]")])
def test_names_that_look_alike_are_told_apart_whatever_the_order(
    one: str, other: str, clip: Path, tmp_path: Path
) -> None:
    for text in (one, other):
        shutil.copy(clip, tmp_path / f"{text}.mp4")
    paths = [str(tmp_path / f"{text}.mp4") for text in (one, other)]
    names = unique_names(paths)
    assert len(set(names)) == 2
    assert unique_names(paths[::-1]) == names[::-1]


def test_one_name_in_two_spellings_of_its_accent_is_refused(tmp_path: Path) -> None:
    paths = [str(tmp_path / f"{unicodedata.normalize(form, 'café')}.mp4") for form in ("NFC", "NFD")]
    assert paths[0] != paths[1]
    with pytest.raises(VideoError, match="have one name"):
        unique_names(paths)


@pytest.mark.parametrize("kind", ["CJK", "emoji", "a family"])
def test_a_run_of_a_video_with_any_letters_leaves_its_masks(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path / f"{LETTERS[kind]}.mp4", range(4), size=(64, 48))
    report, _ = segment(path, tmp_path)
    assert not report.failures
    assert masks(tmp_path / "out" / report.names[0]).shape == (4, 48, 64)


def test_a_name_that_is_no_unicode_is_refused_in_one_line(tmp_path: Path) -> None:
    path = write(tmp_path / f"{LETTERS['another encoding']}.mp4", range(4), size=(64, 48))
    with pytest.raises(StageError, match="text or a name in another encoding than UTF-8"):
        segment(path, tmp_path)


def test_frames_with_names_as_long_as_can_be_leave_their_masks(tmp_path: Path) -> None:
    folder = tmp_path / "shot"
    folder.mkdir()
    for n in range(4):
        cv2.imwrite(str(folder / f"{'漢' * 82}{n:04d}.png"), coded(n, 64, 48))
    report, _ = segment(folder, tmp_path)
    assert not report.failures
    assert sorted(p.name for p in (tmp_path / "out/shot/masks").iterdir()) == sorted(
        p.name for p in folder.iterdir()
    )


# ---------------------------------------------------------------------- neither file nor folder
@contextmanager
def bound(path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A socket; its name may be no longer than 100 letters."""
    monkeypatch.chdir(path.parent)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path.name)
        yield path


def test_what_is_neither_file_nor_folder_has_a_line_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    with bound(tmp_path / "socket.mp4", monkeypatch) as address:
        for given, words in {
            "/dev/null": "is a device; give a video file",
            str(tmp_path / "pipe.mp4"): "is a pipe, which can be read only once; give",
            str(address): "is a socket; give a video",
            "-": "is standard input",
            "rtsp://camera/1": "is a URL of a kind that is not known",
            "https://youtu.be/watch?v=1": "holds a name, password, token or query",
        }.items():
            with pytest.raises(VideoError, match=words):
                found(given)
        with pytest.raises(VideoError, match="holds neither frames nor videos"):
            found(tmp_path)
        frames(tmp_path)
        (tmp_path / "0001.png").unlink()
        os.mkfifo(tmp_path / "0001.png")
        assert numbers(look(tmp_path)) == [0, 2]
        assert numbers(look(tmp_path / "*.png")) == [0, 2]


def test_a_link_that_leads_nowhere_is_a_frame_that_is_missed(tmp_path: Path) -> None:
    frames(tmp_path)
    (tmp_path / "0001.png").unlink()
    (tmp_path / "0001.png").symlink_to(tmp_path / "gone.png")
    with pytest.raises(VideoError, match=r"0001\.png: cannot be read as an image"):
        look(tmp_path)


# ---------------------------------------------------------------------- odd pictures
BEHIND = {
    "zeros": bytes(900),
    "a film": b"\x00\x00\x00\x18ftypmp42" + bytes(range(256)) * 8,
    "a scan": b"\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00" + bytes(90),
    "a picture that is cut off": b"\xff\xd8\xff\xdb\x00\x04ab\xff\xda\x00\x04cd" + b"x" * 90,
    "words": b"\r\n--boundary\r\nContent-Type: image/jpeg\r\n",
}


@pytest.mark.parametrize("kind", BEHIND)
@pytest.mark.parametrize(
    "options", [{}, {"progressive": True}, {"comment": b"\xff\xd9 \xff\xda"}, {"restart_marker_rows": 1}]
)
def test_bytes_behind_the_end_of_a_jpeg_are_no_damage(
    kind: str, options: dict[str, object], tmp_path: Path
) -> None:
    for n in range(2):
        path = tmp_path / f"{n}.jpg"
        Image.fromarray(coded(n)).save(path, **options)
        path.write_bytes(path.read_bytes() + BEHIND[kind])
    assert numbers(look(tmp_path)) == [0, 1]
    path.write_bytes(
        path.read_bytes().partition(b"\xff\xd9")[0][:-40]
        if "comment" not in options
        else path.read_bytes()[:700]
    )
    with pytest.raises(VideoError, match=r"1\.jpg: cannot be read as an image, or is cut off"):
        numbers(look(tmp_path))


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("grey", [True, False])
def test_pictures_of_fewer_bits_in_16_are_scaled_by_what_is_there(
    bits: int, grey: bool, ending: str, tmp_path: Path
) -> None:
    images = [(coded(n).astype(np.uint32) * ((1 << bits) - 1) // 255).astype(np.uint16) for n in (1, 21)]
    images[1][0, 0] = (1 << bits) - 1
    for n, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{n}.{ending}"), image[..., 0] if grey else image)
    looked = look(tmp_path)
    assert numbers(looked) == [1, 21]
    assert looked.notes == (
        f"its images of 16 bits hold values up to {(1 << bits) - 1}: taken as {bits} bits",
    )
    assert type(looked).from_json(looked.to_json()) == looked


def test_pictures_of_16_bits_are_scaled_as_ever(tmp_path: Path) -> None:
    for n in range(2):
        cv2.imwrite(str(tmp_path / f"{n}.png"), coded(n).astype(np.uint16) * 257)
    assert look(tmp_path).bits == 16
    assert look(tmp_path).notes == ()
