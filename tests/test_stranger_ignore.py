"""Ignore masks as people have them: read by what one sees, of the shape of the frames, and never more than they should be."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_folder
from PIL import Image
from runs import masks, segment

from zsmoseg.errors import SettingsError, StageError, ZsmosegError
from zsmoseg.video.ignore import describe_ignore, read_ignore
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import open_store
from zsmoseg.workflows.stages.graph import GRAPHS

HEIGHT, WIDTH = 120, 160
WANTED = np.zeros((HEIGHT, WIDTH), bool)
WANTED[100:] = True
GREY = np.where(WANTED, 255, 0).astype(np.uint8)


def png(path: Path, image: Any, **more: Any) -> Path:
    Image.fromarray(image).save(path, **more)
    return path


def rgba(colour: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return np.dstack([colour, colour, colour, alpha]).astype(np.uint8)


def palette(path: Path, index: np.ndarray, colours: list[int], **more: Any) -> Path:
    image = Image.fromarray(index.astype(np.uint8), "P")
    image.putpalette(colours + [0] * (768 - len(colours)))
    image.save(path, **more)
    return path


def noisy(path: Path, **more: Any) -> Path:
    """As a picture that was JPEG once."""
    Image.fromarray(GREY).save(path.with_suffix(".jpg"), quality=20)
    return png(path, np.asarray(Image.open(path.with_suffix(".jpg"))), **more)


DRAWN: dict[str, Callable[[Path], Path]] = {
    "black and white": lambda p: png(p / "m.png", GREY),
    "0 and 1": lambda p: png(p / "m.png", GREY // 255),
    "two levels": lambda p: png(p / "m.png", WANTED),
    "16 bits": lambda p: png(p / "m.png", GREY.astype(np.uint16) * 257),
    "labels": lambda p: png(p / "m.png", np.where(WANTED, 1 + np.arange(WIDTH) // 40, 0).astype(np.uint8)),
    "red": lambda p: png(p / "m.png", np.dstack([GREY, GREY * 0, GREY * 0])),
    "dark blue": lambda p: png(p / "m.png", np.dstack([GREY * 0, GREY * 0, GREY // 100])),
    "JPEG": lambda p: png(p / "m.jpg", GREY, quality=60),
    "poor JPEG": lambda p: png(p / "m.jpg", GREY, quality=10),
    "made from a JPEG": lambda p: noisy(p / "m.png"),
    "WebP": lambda p: png(p / "m.webp", GREY, quality=40),
    "BMP": lambda p: png(p / "m.bmp", GREY),
    "TIFF": lambda p: png(p / "m.tif", GREY),
    "black on nothing": lambda p: png(p / "m.png", rgba(GREY * 0, GREY)),
    "white on nothing": lambda p: png(p / "m.png", rgba(GREY, GREY)),
    "white, hidden everywhere": lambda p: png(p / "m.png", rgba(GREY * 0 + 255, GREY)),
    "half transparent": lambda p: png(p / "m.png", rgba(GREY * 0 + 255, GREY // 2)),
    "opaque": lambda p: png(p / "m.png", rgba(GREY, GREY * 0 + 255)),
    "opaque black and white, cut": lambda p: png(
        p / "m.png", rgba(GREY, np.where(np.mgrid[:HEIGHT, :WIDTH][0] < 30, 0, 255))
    ),
    "grey with alpha": lambda p: png(p / "m.png", np.dstack([GREY * 0 + 200, GREY]).astype(np.uint8)),
    "palette": lambda p: palette(p / "m.png", WANTED, [0, 0, 0, 255, 255, 255]),
    "palette, turned round": lambda p: palette(p / "m.png", ~WANTED, [255, 255, 255, 0, 0, 0]),
    "palette of labels": lambda p: palette(p / "m.png", WANTED * 3, [0, 0, 0, 1, 1, 1, 2, 2, 2, 64, 0, 0]),
    "palette, transparent": lambda p: palette(p / "m.png", WANTED, [9, 9, 9, 90, 0, 0], transparency=0),
    "GIF": lambda p: palette(p / "m.gif", WANTED, [0, 0, 0, 255, 255, 255]),
}


@pytest.mark.parametrize("kind", DRAWN)
def test_what_one_sees_is_ignored(kind: str, tmp_path: Path) -> None:
    path = str(DRAWN[kind](tmp_path))
    wrong = (read_ignore(path, HEIGHT, WIDTH) != WANTED).mean()
    assert wrong == 0 or (kind in ("JPEG", "poor JPEG", "WebP", "made from a JPEG") and wrong < 0.01)
    assert describe_ignore(path, HEIGHT, WIDTH).startswith("ignored: 1")


def marks(count: int, kind: str) -> np.ndarray:
    """Ids from 1 on, on black."""
    image = np.zeros((HEIGHT, WIDTH), np.uint16)
    for n in range(count):
        y, x = 6 + 12 * (n // 13), 6 + 12 * (n % 13)
        if kind == "discs":
            cv2.circle(image, (x, y), 4, n + 1, -1)
        elif kind == "boxes":
            image[y - 6 : y + 6, x - 6 : x + 6] = n + 1
        else:
            image[y - 1 : y + 2, x - 5 : x + 6] = n + 1
    return image


@pytest.mark.parametrize("kind", ["discs", "boxes", "lines"])
@pytest.mark.parametrize("count", [3, 17, 30, 117])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_every_id_is_ignored_however_many_there_are(
    depth: type[Any], count: int, kind: str, tmp_path: Path
) -> None:
    image = marks(count, kind).astype(depth)
    path = str(png(tmp_path / "m.png", image))
    np.testing.assert_array_equal(read_ignore(path, HEIGHT, WIDTH), image > 0)
    assert describe_ignore(path, HEIGHT, WIDTH).endswith(" of every frame (m.png)")


SHADES: dict[str, Callable[[Path], Path]] = {
    "soft": lambda p: png(p / "m.png", cv2.GaussianBlur(GREY, (0, 0), 5)),
    "softer": lambda p: png(p / "m.png", cv2.GaussianBlur(GREY, (0, 0), 7)),
    "JPEG": DRAWN["JPEG"],
    "black that is not quite": lambda p: png(p / "m.png", np.maximum(cv2.GaussianBlur(GREY, (0, 0), 5), 1)),
    "soft, tilted": lambda p: png(
        p / "m.png", np.clip((np.mgrid[:HEIGHT, :WIDTH][0] - 90) * 13, 0, 255).astype(np.uint8)
    ),
}


@pytest.mark.parametrize("kind", SHADES)
def test_of_shades_the_brighter_half_is_ignored_and_the_rule_is_told(kind: str, tmp_path: Path) -> None:
    path = str(SHADES[kind](tmp_path))
    assert (read_ignore(path, HEIGHT, WIDTH) != WANTED).mean() < 0.01
    assert describe_ignore(path, HEIGHT, WIDTH).endswith(", of its shades what is brighter than half)")


@pytest.mark.parametrize(("height", "width"), [(240, 320), (60, 80), (1080, 1440), (61, 81), (122, 163)])
def test_a_scale_of_the_frames_is_taken_and_said(height: int, width: int, tmp_path: Path) -> None:
    path = str(png(tmp_path / "m.png", cv2.resize(GREY, (width, height), interpolation=cv2.INTER_NEAREST)))
    assert describe_ignore(path, HEIGHT, WIDTH).endswith(
        f" % of every frame (m.png, scaled from {width} x {height})"
    )


@pytest.mark.parametrize(
    ("height", "width"), [(160, 120), (120, 120), (100, 160), (240, 300), (2, 300), (68, 120)]
)
def test_another_shape_than_the_frames_is_refused(height: int, width: int, tmp_path: Path) -> None:
    path = str(png(tmp_path / "m.png", cv2.resize(GREY, (width, height), interpolation=cv2.INTER_NEAREST)))
    with pytest.raises(
        SettingsError, match=rf"m\.png: .* is {width} x {height}, the frames are 160 x 120; give one"
    ):
        describe_ignore(path, HEIGHT, WIDTH)


@pytest.mark.parametrize("left", [0, 1, 100])
def test_a_mask_that_leaves_next_to_nothing_is_refused(left: int, tmp_path: Path) -> None:
    image = GREY * 0 + 255
    image.reshape(-1)[:left] = 0
    with pytest.raises(
        SettingsError, match=r"leaves (nothing|0\.\d+ %) of the frame; what is not black in it is ignored"
    ):
        describe_ignore(str(png(tmp_path / "m.png", image)), HEIGHT, WIDTH)


def test_a_mask_that_ignores_nothing_is_told(tmp_path: Path) -> None:
    path = str(png(tmp_path / "m.png", GREY * 0))
    assert describe_ignore(path, HEIGHT, WIDTH) == "ignored: nothing of every frame (m.png)"


# ---------------------------------------------------------------------- runs
@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "disc", draw_clip(frames=4)[0])


def contents(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@pytest.mark.parametrize(
    ("mask", "words"), [(GREY * 0 + 255, "leaves nothing"), (np.rot90(GREY), "the frames are 160 x 120")]
)
def test_nothing_good_is_overwritten_by_a_run_whose_mask_does_not_fit(
    mask: np.ndarray, words: str, clip: Path, tmp_path: Path
) -> None:
    segment(clip, tmp_path)
    before = contents(tmp_path / "out")
    assert masks(tmp_path / "out/disc").any()
    with pytest.raises(ZsmosegError, match=words):
        segment(clip, tmp_path, {"ignore.mask": str(png(tmp_path / "m.png", mask))})
    assert contents(tmp_path / "out") == before


def test_of_several_videos_those_fail_that_the_mask_does_not_fit(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_folder(tmp_path / "other", draw_clip(frames=4, height=48, width=80)[0])
    report, _ = segment([clip, other], tmp_path, {"ignore.mask": str(png(tmp_path / "m.png", GREY))})
    assert report.finished == ["disc"]
    assert "the frames are 80 x 48" in report.failures["other"]
    narrow = str(png(tmp_path / "narrow.png", GREY[:, :50]))
    with pytest.raises(StageError, match=r"none of the 2 videos can be run; the first: .*ignore mask"):
        segment([clip, other], tmp_path, {"ignore.mask": narrow})
    words = ["run", str(clip), str(other), "-o", str(tmp_path / "new"), "--dry-run", "--ignore"]
    assert main([*words, narrow]) == 2
    told = capsys.readouterr()
    assert "none of the 2 videos can be run; the first: " in told.err
    assert "nothing to do" not in told.out
    assert main([*words, str(tmp_path / "m.png")]) == 0, "one of them can"


def test_the_share_is_in_the_first_lines_and_in_the_summary(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(clip), "-o", str(tmp_path / "out"), "--ignore", str(png(tmp_path / "m.png", GREY))]
    assert main([*words, "--dry-run"]) == 0
    line = "ignored: 16.7 % of every frame (m.png)"
    assert capsys.readouterr().out.splitlines()[1].strip() == line
    assert main([*words, "--scheduler", "serial"]) == 0
    assert capsys.readouterr().err.splitlines()[1].strip() == line
    assert line in (tmp_path / "out/disc/summary.json").read_text()
    assert not masks(tmp_path / "out/disc")[:, 100:].any()


PLACES = {1: (10, 10), 2: (10, 100), 5: (80, 100)}
"""Corner of each of three squares, y and x."""


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        ((), ""),
        ((2,), "left out: 1 object that lies wholly in what is ignored (2)"),
        ((2, 5), "left out: 2 objects that lie wholly in what is ignored (2, 5)"),
        ((1, 2, 5), "left out: 3 objects that lie wholly in what is ignored (1, 2, 5)"),
    ],
)
def test_objects_of_which_everything_is_ignored_are_named(
    lost: tuple[int, ...], words: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    brought, ignore = np.zeros((4, 120, 160), np.uint8), np.zeros((120, 160), np.uint8)
    for n, (y, x) in PLACES.items():
        brought[:, y : y + 24, x : x + 24] = n
        ignore[y : y + 24 if n in lost else y + 10, x : x + 24] = 255
    np.save(tmp_path / "masks.npy", brought)
    segment(
        clip,
        tmp_path,
        {"proposals.path": str(tmp_path / "masks.npy"), "ignore.mask": str(png(tmp_path / "m.png", ignore))},
    )
    result = open_store(tmp_path / "store")["disc"]
    assert result.warnings == result.summary["warnings"]
    told = [text for text in result.warnings if "ignored" in text]
    assert [text.split(";")[0] for text in told] == ([words] if words else [])
    assert not any("bring masks" in text for text in result.warnings)
    assert result.objects["object"].tolist() == [0, *(n for n in PLACES if n not in lost)]
    explain = ["explain", "disc", "--store", str(tmp_path / "store"), "--object"]
    for n in PLACES:
        capsys.readouterr()
        assert main([*explain, str(n)]) == 0
        assert ("lies wholly in what is ignored" in capsys.readouterr().out) == (n in lost)
    assert main([*explain, "4"]) == 2


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "text", "none"])
def test_what_is_no_image_is_named(
    kind: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.png"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "text":
        path.write_text("nothing")
    given = "/dev/null" if kind == "device" else str(path)
    assert (
        main(["run", str(clip), "-o", str(tmp_path / "out"), "--ignore", given, "--scheduler", "serial"]) == 2
    )
    assert f"{given}: the ignore mask cannot be read" in capsys.readouterr().err.splitlines()[-1]


def test_every_stage_that_reads_the_mask_has_another_key_with_it(clip: Path, tmp_path: Path) -> None:
    reads = {stage.name for stage in GRAPHS["embedded-flow"].values() if "ignore" in stage.section_names}
    _, plain = segment(clip, tmp_path)
    _, masked = segment(clip, tmp_path, {"ignore.mask": str(png(tmp_path / "m.png", GREY))})
    keys = [{name: stage.key for name, stage in run.plans[0].stages.items()} for run in (plain, masked)]
    assert reads
    assert all(keys[0][name] != keys[1][name] for name in reads)
    assert keys[0]["frames"] == keys[1]["frames"]
