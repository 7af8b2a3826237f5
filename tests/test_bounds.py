"""A file that states a size gets no more memory than the bound, and an error that names it: nothing is made before."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from conftest import draw_clip, write_folder, write_mp4
from numpy.lib import format as npy
from PIL import Image

from zsmoseg.errors import FormatError, VideoError
from zsmoseg.formats import open_depth, open_flow, open_masks
from zsmoseg.formats.names import frame_number
from zsmoseg.video import decoding
from zsmoseg.video.bounds import PIXELS, SIDE, TooLarge, check_size
from zsmoseg.video.decoding import Way
from zsmoseg.video.pixels import image_size, pixels
from zsmoseg.video.probe import Excerpt, Probe, probe
from zsmoseg.workflows.stage import SMALLEST, working_size

EXCERPT = Excerpt("", "", 1, 25.0, False)
NAN, INFINITY = float("nan"), float("inf")


def png(path: Path, width: int, height: int, depth: int = 8, kind: int = 0) -> Path:
    """A PNG that states a size and holds one row."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    return path


def head_of(shape: tuple[int, ...], dtype: str = "<f4") -> bytes:
    """The head of an .npy that states a shape, and 64 bytes."""
    out = BytesIO()
    npy.write_array_header_1_0(out, {"descr": dtype, "fortran_order": False, "shape": shape})
    return out.getvalue() + bytes(64)


def array(path: Path, shape: tuple[int, ...], dtype: str = "<f4") -> Path:
    if path.suffix == ".npy":
        path.write_bytes(head_of(shape, dtype))
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("flow.npy", head_of(shape, dtype))
    return path


def exr(path: Path, width: int, height: int) -> Path:
    """The head of an OpenEXR file."""
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    path.write_bytes(
        b"\x76\x2f\x31\x01\2\0\0\0" + b"dataWindow\0box2i\0" + struct.pack("<i", 16) + window + b"\0"
    )
    return path


def coco(path: Path, segmentation: Any, size: tuple[int, int] = (12, 17), **more: Any) -> Path:
    image = {"id": 1, "file_name": "00000.png", "height": size[0], "width": size[1]}
    annotation = {"id": 1, "image_id": 1, "category_id": 1, "segmentation": segmentation, **more}
    path.write_text(json.dumps({"images": [image], "annotations": [annotation], "categories": []}))
    return path


# ---------------------------------------------------------------------- sizes
@pytest.mark.parametrize(
    ("height", "width"),
    [
        (100_000, 1),
        (1, 100_000),
        (SIDE + 1, SIDE),
        (SIDE, SIDE),
        (2000, 20),
        (0, 5),
        (-3, -5),
        (2**31, 2**31),
    ],
)
def test_sizes_beyond_the_bounds_are_refused_with_both(height: int, width: int) -> None:
    with pytest.raises(TooLarge, match=f"{width} px wide and {height} px high; .*[0-9]"):
        check_size(height, width)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 1000), (4320, 7680), (8192, 8192), (SIDE, 2000)])
def test_sizes_that_cameras_and_scanners_have_are_taken(height: int, width: int) -> None:
    check_size(height, width)


def test_the_working_grid_of_the_slimmest_source_is_small() -> None:
    """The grid has sides of 16 px at least, so a source one pixel wide has a grid 16 times as long."""
    for height in (1, 16, 1024, 2000, SIDE):
        for width in (1, 16, 1024, 2000, SIDE):
            try:
                check_size(height, width)
            except TooLarge:
                continue
            source = Probe("x", (), (), Way(), (), (), width, height)
            for wanted in (SMALLEST, 480, SIDE):
                rows, columns = working_size(source, wanted)
                assert rows * columns <= PIXELS


# ---------------------------------------------------------------------- images and videos
@pytest.mark.parametrize(
    ("width", "height"), [(1, 100_000), (60_000, 60_000), (9000, 11_000), (13_000, 13_000)]
)
def test_an_image_that_states_too_large_a_size_is_no_frame(width: int, height: int, tmp_path: Path) -> None:
    file = png(tmp_path / "00000.png", width, height)
    for look in (image_size, pixels):
        with pytest.raises(VideoError, match=r"00000\.png: is .*(px wide|too large).*; .*replace it"):
            look(str(file))
    write_folder(tmp_path / "clip", draw_clip(0, 3)[0])
    png(tmp_path / "clip" / "00001.png", width, height)
    with pytest.raises(VideoError, match=r"00001\.png: is"):
        probe(str(tmp_path / "clip"), EXCERPT)


def test_a_jpeg_that_states_too_large_a_size_is_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "00000.jpg"
    for options in ({}, {"progressive": True}, {"icc_profile": bytes(70_000)}, {"comment": "wide"}):
        Image.fromarray(draw_clip(0, 2)[0][0]).save(path, **options)
        whole = path.read_bytes()
        assert pixels(str(path)) is not None
        place = whole.index(struct.pack(">HH", 120, 160))
        path.write_bytes(whole[:place] + struct.pack(">HH", 60_000, 60_001) + whole[place + 4 :])
        with pytest.raises(VideoError, match=r"00000\.jpg: is 60001 px wide and 60000 px high"):
            pixels(str(path))


def _bmp(data: bytearray) -> None:
    struct.pack_into("<ii", data, 18, 60_000, 60_001)


def _tif(data: bytearray) -> None:
    for tag in (256, 257):
        struct.pack_into("<I", data, data.index(struct.pack("<HHI", tag, 4, 1)) + 8, 60_000)


def _webp(data: bytearray) -> None:
    """Lossless: 14 bits for each side less one."""
    struct.pack_into("<I", data, data.index(b"VP8L") + 9, 16_383 | 16_383 << 14)


@pytest.mark.parametrize(("ending", "enlarge"), [("bmp", _bmp), ("tif", _tif), ("webp", _webp)])
def test_other_images_that_state_too_large_a_size_are_not_decoded(
    ending: str, enlarge: Callable[[bytearray], None], tmp_path: Path
) -> None:
    path = tmp_path / f"00000.{ending}"
    Image.fromarray(draw_clip(0, 2)[0][0]).save(path, lossless=True)
    assert image_size(str(path)) == (160, 120)
    data = bytearray(path.read_bytes())
    enlarge(data)
    path.write_bytes(bytes(data))
    for look in (image_size, pixels):
        with pytest.raises(VideoError, match=r"00000\.\w+: is .*(px wide|too large)"):
            look(str(path))


def test_a_video_file_that_states_too_large_a_size_is_refused_before_a_frame_is_decoded(
    tmp_path: Path,
) -> None:
    path = tmp_path / "clip.avi"
    with av.open(str(path), "w", format="avi") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 2048, 16, "yuv420p"
        for _ in range(3):
            image = av.VideoFrame.from_ndarray(np.zeros((16, 2048, 3), np.uint8), "bgr24")
            for packet in stream.encode(image):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)
    with pytest.raises(VideoError, match=r"clip\.avi: is 2048 px wide and 16 px high; one side"):
        probe(str(path), EXCERPT)


def test_ffmpeg_makes_no_frame_beyond_the_bound_whatever_the_stream_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_mp4(tmp_path / "clip.mp4", draw_clip(0, 3, 96, 128)[0])
    assert len(probe(str(path), EXCERPT).pts) == 3
    monkeypatch.setitem(decoding.LIMIT, "max_pixels", str(128 * 96 - 1))
    with pytest.raises(VideoError, match="cannot be decoded"):
        probe(str(path), EXCERPT)


# ---------------------------------------------------------------------- masks, flow, depth
def _masks_png(folder: Path) -> Any:
    return open_masks(png(folder / "00000.png", 1, 100_000).parent)


def _masks_bomb(folder: Path) -> Any:
    return open_masks(png(folder / "00000.png", 60_000, 60_000).parent)


def _volume(folder: Path) -> Any:
    return open_masks(array(folder / "a.npz", (3, 1 << 20, 1 << 20), "<u2"))


def _volume_rows(folder: Path) -> Any:
    return open_masks(array(folder / "a.npy", (1 << 50, 4, 4), "<u2"))


def _detections(folder: Path) -> Any:
    size, one = np.array([1 << 20, 1 << 20]), np.zeros(1, int)
    np.savez(folder / "a.npz", frame=one, score=np.ones(1), packed=np.zeros((1, 9), np.uint8), size=size)
    return open_masks(folder / "a.npz")


def _detections_negative(folder: Path) -> Any:
    one = np.zeros(1, int)
    np.savez(
        folder / "a.npz",
        frame=one,
        score=np.ones(1),
        packed=np.zeros((1, 1), np.uint8),
        size=-np.ones(2, int),
    )
    return open_masks(folder / "a.npz")


def _proposals(folder: Path) -> Any:
    np.savez(folder / "proposals_0.npz", packed=np.zeros((1, 9), np.uint8), shape=np.array([1, 1 << 40, 1]))
    return open_masks(folder)


def _many(folder: Path) -> Any:
    """As many small run lengths of a large image as would take 200 GB as masks."""
    run = {"size": [8192, 8192], "counts": [8192 * 8192]}
    image = {"id": 1, "file_name": "00000.png", "height": 8192, "width": 8192}
    many = [{"id": n, "image_id": 1, "category_id": 1, "segmentation": run} for n in range(3000)]
    (folder / "a.json").write_text(json.dumps({"images": [image], "annotations": many, "categories": []}))
    return open_masks(folder / "a.json").read(0)


def _flo(width: int, height: int) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        (folder / "0.flo").write_bytes(b"PIEH" + struct.pack("<ii", width, height) + bytes(64))
        return open_flow(folder).read(0)

    return read


def _slim_flo(folder: Path) -> Any:
    (folder / "0.flo").write_bytes(b"PIEH" + struct.pack("<ii", 1, 2000) + bytes(8 * 2000))
    return open_flow(folder).read(0)


def _many_arrays(folder: Path) -> Any:
    """Each of a size that is believed, all together 2.5 GB; they are zeros, and take 3 MB packed."""
    with zipfile.ZipFile(folder / "a.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in ("frame", "score", "packed", "size", "more"):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                file.write(head_of((1 << 26, 1 << 3), "|u1")[:-64])
                for _ in range(1 << 5):
                    file.write(bytes(1 << 24))
    return open_masks(folder / "a.npz")


CASES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "png of ids": (_masks_png, "1 px wide and 100000 px high"),
    "png bomb": (_masks_bomb, "too large"),
    "volume of ids": (_volume, "one row would take"),
    "volume of rows": (_volume_rows, "cannot be read"),
    "detections": (_detections, "px wide"),
    "detections of negative size": (_detections_negative, "px wide"),
    "proposals": (_proposals, "px high"),
    "many masks": (_many, "has 3000 masks"),
    "flo": (_flo(1 << 30, 1 << 30), "damaged, or no .flo"),
    "flo of negative size": (_flo(-4, -2), "px wide"),
    "slim flo": (_slim_flo, "1 px wide and 2000 px high"),
    "flow npz": (lambda f: open_flow(array(f / "0.npz", (1 << 20, 1 << 20, 2)).parent).read(0), "states"),
    "flow npy": (lambda f: open_flow(array(f / "0.npy", (1 << 20, 1 << 20, 2)).parent).read(0), "states"),
    "flow of a video": (lambda f: open_flow(array(f / "a.npz", (2, 1 << 20, 1 << 20, 2))), "one row would take"),
    "kitti": (lambda f: open_flow(png(f / "0.png", 60_000, 60_000, 16, 2).parent).read(0), "too large"),
    "depth png": (lambda f: open_depth(png(f / "0.png", 1, 100_000, 16).parent).read(0), "1 px wide"),
    "depth npy": (lambda f: open_depth(array(f / "0.npy", (1 << 20, 1 << 20)).parent).read(0), "states"),
    "depth npy of negative sides": (lambda f: open_depth(array(f / "0.npy", (-4, -4)).parent).read(0), "shape"),
    "depth exr": (lambda f: open_depth(exr(f / "0.exr", 60_000, 60_000).parent).read(0), "px wide"),
    "depth exr of negative size": (lambda f: open_depth(exr(f / "0.exr", -5, 7).parent).read(0), "px wide"),
    "many arrays": (_many_arrays, "would take 2.7 GB at once; at most 2.1 GB"),
    "objects": (lambda f: open_masks(array(f / "a.npy", (3, 4, 4), "|O")), "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_file_of_masks_flow_or_depth_that_states_too_much_is_refused_by_name(
    name: str, tmp_path: Path
) -> None:
    read, message = CASES[name]
    with pytest.raises(FormatError, match=message) as found:
        read(tmp_path)
    assert str(tmp_path) in str(found.value)
    assert "\n" not in str(found.value)


# ---------------------------------------------------------------------- polygons and run lengths
SQUARE = [2.0, 1.0, 9.0, 1.0, 9.0, 8.0, 2.0, 8.0]
SEGMENTATIONS: list[Any] = [
    [[NAN, *SQUARE[1:]]],
    [[1e9, *SQUARE[1:]]],
    [[-1e9, *SQUARE[1:]]],
    [[INFINITY, *SQUARE[1:]]],
    [[1e308, *SQUARE[1:]]],
    [SQUARE, [1e9] * 6],
    [SQUARE[:5]],
    [[0.0, 0.0, 16.0, 11.0] * 200_000],
    [[[0.0, 1.0], [2.0]]],
    [["a"] * 6],
    {"size": [12, 17], "counts": [1 << 70]},
    {"size": [12, 17], "counts": [-(1 << 70), (1 << 70) + 204]},
    {"size": [12, 17], "counts": [NAN, 204]},
    {"size": [12, 17], "counts": []},
    {"size": [12, 17], "counts": "o" * 1_000_000},
    {"size": [12, 17], "counts": "~"},
    {"size": [12, 17], "counts": {}},
    {"size": [1 << 30, 1 << 30], "counts": [1 << 60]},
    {"size": None, "counts": [204]},
]


@pytest.mark.parametrize("number", range(len(SEGMENTATIONS)))
def test_segmentations_with_numbers_that_mean_nothing_are_refused(number: int, tmp_path: Path) -> None:
    source = open_masks(coco(tmp_path / "a.json", SEGMENTATIONS[number]))
    with pytest.raises(
        FormatError, match=r"a\.json, 00000\.png, annotation 1: the (segmentation|run lengths)"
    ):
        source.read(0)


@pytest.mark.parametrize("score", [NAN, INFINITY, 10**400], ids=["nan", "inf", "large"])
def test_scores_that_mean_nothing_are_refused(score: float, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="the score of annotation 1 is no number"):
        open_masks(coco(tmp_path / "a.json", [SQUARE], score=score)).read(0)


@pytest.mark.parametrize("size", [(1 << 31, 1 << 31), (1, 100_000), (0, 5), (-4, -4)])
def test_sizes_in_json_are_compared_with_the_bounds(size: tuple[int, int], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"a\.json, 00000\.png: is .* px high"):
        open_masks(coco(tmp_path / "a.json", [SQUARE], size))
    video = {"id": 1, "name": "goat", "file_names": ["0.png"], "height": size[0], "width": size[1]}
    (tmp_path / "b.json").write_text(json.dumps({"videos": [video], "annotations": []}))
    with pytest.raises(FormatError, match=r"b\.json, video goat: is .* px high"):
        open_masks(tmp_path / "b.json")


def test_a_name_with_a_million_digits_has_no_number() -> None:
    assert frame_number("frame" + "1" * 1_000_000) is None
    assert frame_number("frame012") == 12


SCRIPT = """
import resource, sys
sys.path.insert(0, "tests")
from pathlib import Path
import test_bounds
from zsmoseg.errors import FormatError, VideoError
folder = Path(sys.argv[1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for n, (read, _) in enumerate(test_bounds.CASES.values()):
    (folder / str(n)).mkdir()
    try:
        read(folder / str(n))
    except FormatError:
        pass
for n, segmentation in enumerate(test_bounds.SEGMENTATIONS):
    try:
        test_bounds.open_masks(test_bounds.coco(folder / f"{n}.json", segmentation)).read(0)
    except FormatError:
        pass
for name, size in {"a": (1, 100_000), "b": (60_000, 60_000)}.items():
    for look in (test_bounds.image_size, test_bounds.pixels):
        try:
            look(str(test_bounds.png(folder / f"{name}.png", *size)))
        except VideoError:
            pass
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_all_of_these_together_take_less_than_200_mb(tmp_path: Path) -> None:
    """They took 12 GB, 2 GB, or the process."""
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[1], check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 200_000
