"""Images as strangers' programs write them: which are frames, and what is said of the others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from coded import coded, look, numbers
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.video.ignore import describe_ignore


def picture(number: int) -> Image.Image:
    return Image.fromarray(np.ascontiguousarray(coded(number)[..., ::-1]))


def folder(path: Path, ending: str, save: Callable[[Path, int], Any], count: int = 4) -> Path:
    path.mkdir()
    for n in range(count):
        save(path / f"{n}.{ending}", n)
    return path


def series(path: Path, *pages: Image.Image, **more: Any) -> None:
    pages[0].save(path, save_all=True, append_images=pages[1:], **more)


@pytest.mark.parametrize(
    ("ending", "more"),
    [("tif", {}), ("tif", {"big_tiff": True}), ("tiff", {"compression": "tiff_lzw"}), ("webp", {"lossless": True}), ("png", {}),
     ("png", {"default_image": True})],
)  # fmt: skip
def test_a_file_of_several_pictures_is_no_frame(ending: str, more: dict[str, Any], tmp_path: Path) -> None:
    path = folder(tmp_path / "a", ending, lambda p, n: picture(n).save(p))
    series(path / f"2.{ending}", picture(2), picture(3), picture(4), **more)
    with pytest.raises(
        VideoError, match=rf"a/2\.{ending}: holds several pictures, one a frame is expected; replace it"
    ):
        look(path)


def test_small_copies_and_masks_of_a_picture_are_no_frames(tmp_path: Path) -> None:
    def save(path: Path, n: int) -> None:
        mask = picture(n)
        mask.encoderinfo = {"tiffinfo": {254: 4}}
        series(path, picture(n), picture(n).resize((40, 22)), mask)

    assert numbers(look(folder(tmp_path / "a", "tif", save))) == [0, 1, 2, 3]


# ---------------------------------------------------------------------- numbers
ODD: dict[str, tuple[Callable[[Path, int], Any], str]] = {
    "float": (
        lambda p, n: Image.fromarray(np.float32(coded(n)[..., 0])).save(p),
        "floating point values of 32",
    ),
    "float, colour": (lambda p, n: cv2.imwrite(str(p), np.float32(coded(n))), "floating point values of 32"),
    "double": (lambda p, n: cv2.imwrite(str(p), np.float64(coded(n))), "floating point values of 64"),
    "int32": (lambda p, n: Image.fromarray(np.int32(coded(n)[..., 0])).save(p), "values of 32"),
}


@pytest.mark.parametrize("kind", ODD)
def test_numbers_that_are_not_read_are_named(
    kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    save, words = ODD[kind]
    path = folder(tmp_path / "a", "tif", save)
    with pytest.raises(
        VideoError, match=rf"a/0\.tif: has {words} bits, whole numbers of 8 or 16 are expected"
    ):
        look(path)
    with pytest.raises(SettingsError, match=rf"a/0\.tif: the ignore mask has {words} bits, .* to --ignore$"):
        describe_ignore(str(path / "0.tif"), 90, 160)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", ["bmp", "webp", "tif", "png", "jpg"])
def test_of_damage_nothing_is_said_but_one_line(
    ending: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = folder(tmp_path / "a", ending, lambda p, n: cv2.imwrite(str(p), coded(n)))
    whole = (path / f"0.{ending}").read_bytes()
    (path / f"0.{ending}").write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(VideoError, match=rf"a/0\.{ending}: cannot be read as an image"):
        numbers(look(path))
    assert "ERROR" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("ending", "more"), [("png", {}), ("tif", {}), ("tif", {"big_tiff": True}), ("jpg", {})]
)
@pytest.mark.parametrize("length", [0, 3, 8, 9, 15, 16, 20, 24, 25, 30])
@pytest.mark.filterwarnings("ignore::UserWarning:PIL.TiffImagePlugin")
def test_a_head_that_is_cut_off_is_no_image(
    length: int, ending: str, more: dict[str, Any], tmp_path: Path
) -> None:
    path = folder(tmp_path / "a", ending, lambda p, n: picture(n).save(p, **more))
    (path / f"1.{ending}").write_bytes((path / f"1.{ending}").read_bytes()[:length])
    with pytest.raises(VideoError, match=rf"a/1\.{ending}: cannot be read as an image; replace it"):
        look(path)


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("deep", [[3], [0, 1], [1, 3], [0, 1, 2, 3]])
def test_bits_are_counted_in_every_image_that_has_more_than_8(
    deep: list[int], bits: int, ending: str, tmp_path: Path
) -> None:
    def save(path: Path, n: int) -> None:
        image = np.uint16(coded(n)) << (bits - 8) if n in deep else coded(n)
        cv2.imwrite(str(path), image)

    looked = look(folder(tmp_path / "a", ending, save))
    assert numbers(looked) == [0, 1, 2, 3]
    largest = 220 << (bits - 8)
    assert looked.notes == (f"its images of 16 bits hold values up to {largest}: taken as {bits} bits",)


# ---------------------------------------------------------------------- what stands behind the picture
@pytest.mark.parametrize("ending", ["png", "jpg"])
@pytest.mark.parametrize("behind", [b"\0", b"IEND", b"\xff" * 12, b"GPS log " * 99, bytes(4096)])
def test_bytes_behind_a_picture_count_for_nothing(ending: str, behind: bytes, tmp_path: Path) -> None:
    def save(path: Path, n: int) -> None:
        path.write_bytes(cv2.imencode(f".{ending}", coded(n))[1].tobytes() + behind)

    assert numbers(look(folder(tmp_path / "a", ending, save))) == [0, 1, 2, 3]
    (tmp_path / "mask").write_bytes(cv2.imencode(f".{ending}", np.eye(90, 160) * 255)[1].tobytes() + behind)
    assert describe_ignore(str(tmp_path / "mask"), 90, 160).startswith("ignored: ")


def test_the_word_that_ends_a_png_is_no_end_where_it_stands_in_text(tmp_path: Path) -> None:
    def save(path: Path, n: int) -> None:
        said = PngInfo()
        said.add_text("Comment", "IEND")
        picture(n).save(path, pnginfo=said)

    path = folder(tmp_path / "a", "png", save)
    assert numbers(look(path)) == [0, 1, 2, 3]
    (path / "2.png").write_bytes((path / "2.png").read_bytes()[:-12])
    with pytest.raises(VideoError, match=r"a/2\.png: cannot be read as an image"):
        look(path)
