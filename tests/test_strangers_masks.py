"""Masks, flow and depth as other people's tools write them: what is taken, what is refused, what is counted."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_folder
from PIL import Image

from zsmoseg.errors import FormatError
from zsmoseg.formats import inverse_depth, match_frames, open_depth, open_flow, open_masks
from zsmoseg.formats.flow_files import encode_kitti, write_flo
from zsmoseg.workflows.cli import main

SIZE = (48, 64)
PADDED = [f"{t:05d}" for t in range(20)]
PLAIN = [str(t) for t in range(20)]
CALLED = [f"frame_{t}" for t in range(20)]


def square(t: int = 0, side: int = 14) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[10 : 10 + side, 8 + 3 * t : 8 + 3 * t + side] = 1
    return mask


def polygon(t: int = 0) -> list[float]:
    x, y, side = 8 + 3 * t, 10, 14
    return [x, y, x + side, y, x + side, y + side, x, y + side]


def runs(mask: np.ndarray) -> dict[str, Any]:
    """Run lengths as brush tools write them: a list."""
    flat = np.r_[0, mask.T.ravel(), 1 - mask[-1, -1]]
    return {"size": list(SIZE), "counts": np.diff(np.r_[0, np.flatnonzero(np.diff(flat))]).tolist()}


def coco(path: Path, annotations: list[dict[str, Any]], names: list[str] | None = None) -> Path:
    images = [
        {"id": n, "file_name": name, "height": SIZE[0], "width": SIZE[1]}
        for n, name in enumerate(names or ["00000.png", "00001.png"])
    ]
    numbered = [{"id": n, "category_id": 1, "iscrowd": 0, **a} for n, a in enumerate(annotations, 1)]
    path.write_text(json.dumps({"images": images, "annotations": numbered, "categories": []}))
    return path


# ---------------------------------------------------------------------- which frame
@pytest.mark.parametrize(
    ("entry", "names", "frame"),
    [
        ("00007_png.rf.8c1bd4fe", PADDED, 7),
        ("00007_jpg.rf.0123456789abcdef0123456789abcdef", PADDED, 7),
        ("00007_v2", PADDED, 7),
        ("00007-mask", PADDED, 7),
        ("00007 copy", PADDED, 7),
        ("00007.png", PADDED, 7),
        ("00007mask", PADDED, 7),
        ("1a2b3c4d-00007", PADDED, 7),
        ("fade1234-00007", PADDED, 7),
        ("goat_480p_00007", PADDED, 7),
        ("goat_480p_00007_854", PADDED, 7),
        ("frame_7_mask", CALLED, 7),
        ("frame_7.rf.5d41402a", CALLED, 7),
        ("mask7", CALLED, 7),
        ("000007", PADDED, 7),
        ("7-7", PLAIN, 7),
    ],
)
def test_a_name_belongs_to_the_frame_whose_name_or_only_number_it_holds(
    entry: str, names: list[str], frame: int
) -> None:
    found = match_frames([entry], names)
    assert [t for t, place in enumerate(found) if place is not None] == [frame]


@pytest.mark.parametrize(
    ("entries", "names"),
    [
        (["7_3"], PLAIN),
        (["mask_7_0"], PLAIN),
        (["00007_00008"], PADDED),
        (["00007_3"], PADDED),
        (["00007 (3)"], PADDED),
        (["abc8_7"], CALLED),
        (["cam2_frame7"], CALLED),
        (["00007_1", "00007_2"], CALLED),
        (["a8_b7", "a8_b9"], CALLED),
        (["480_7"], CALLED),
    ],
)
def test_two_numbers_that_compete_are_refused_by_name(entries: list[str], names: list[str]) -> None:
    with pytest.raises(FormatError, match=r"here: .* may belong to .* or to .*; call it like its frame"):
        match_frames(entries, names, "here")


@pytest.mark.parametrize("begin", [1, 2, 100])
@pytest.mark.parametrize("called", ["{:05d}", "{}", "mask_{:04d}", "{:03d}_png"])
@pytest.mark.parametrize("names", [PADDED, PLAIN, CALLED], ids=["padded", "plain", "called"])
def test_numbers_from_another_beginning_are_told_and_nothing_is_to_be_removed(
    begin: int, called: str, names: list[str]
) -> None:
    entries = [called.format(begin + t) for t in range(len(names))]
    with pytest.raises(FormatError) as error:
        match_frames(entries, names, "masks")
    assert (
        f"masks: counts from {begin} ({entries[0]} to {entries[-1]}), the frames of the video from 0"
        in str(error.value)
    )
    assert "rename all" in str(error.value)
    assert "remove" not in str(error.value)


@pytest.mark.parametrize("entry", ["8cbdfe", "8c1bd4fe", "background", "00093", "a93", "7f8a9b0c"])
def test_a_hash_belongs_to_no_frame(entry: str) -> None:
    with pytest.raises(FormatError, match=f"{entry} belongs to no frame"):
        match_frames([entry], PADDED)


@pytest.mark.parametrize(
    ("entries", "names"),
    [
        (["goat_480p_7", "goat_480p_8"], CALLED),
        (["00007_2", "00008_2"], PADDED),
        (["seq_05_00007", "seq_05_00008"], PADDED),
    ],
)
def test_a_number_that_all_names_have_is_none_of_a_frame(entries: list[str], names: list[str]) -> None:
    assert match_frames(entries, names)[6:10] == [None, 0, 1, None]


# ---------------------------------------------------------------------- COCO
CROWD = {"image_id": 0, "segmentation": runs(square()), "iscrowd": 1}
PLAIN_MASK = {"image_id": 0, "segmentation": [polygon()]}


@pytest.mark.parametrize(
    ("more", "ids"),
    [
        ([{"track_id": 7}], [7]),
        ([{"attributes": {"track_id": 7, "occluded": False}}], [7]),
        ([{"attributes": {"instance_id": 7}}], [7]),
        ([{"instance_id": 7.0}], [7]),
        ([{"track_id": 7, "attributes": {"track_id": 9}}], [7]),
        ([{"attributes": {"track_id": 0}}, {"attributes": {"track_id": 5}}], [1, 2]),
        ([{"track_id": "car-10"}, {"track_id": "car-9"}], [2, 1]),
        ([{"track_id": 1 << 40}, {"track_id": -3}], [2, 1]),
        ([{"track_id": "07"}, {"track_id": 7}], [2, 1]),
    ],
)
def test_ids_are_found_where_tools_put_them_and_numbered_where_they_cannot_be_kept(
    more: list[dict[str, Any]], ids: list[int], tmp_path: Path
) -> None:
    given = [{**PLAIN_MASK, "image_id": n, **entry} for n, entry in enumerate(more)]
    source = open_masks(coco(tmp_path / "a.json", given))
    assert source.ids
    assert [int(source.read(n).label.max()) for n in range(len(more))] == ids
    kept = [entry.get("track_id", next(iter(entry.values()))) for entry in more]
    assert bool(source.notes) == (len(kept) > 1), "numbered anew, and said"


@pytest.mark.parametrize(
    "more", [{}, {"track_id": None}, {"attributes": {}}, {"attributes": None}, {"attributes": [3]}]
)
def test_an_id_that_only_some_have_is_refused(more: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"1 of 2 annotations have a track_id"):
        open_masks(coco(tmp_path / "a.json", [{**PLAIN_MASK, "track_id": 1}, {**PLAIN_MASK, **more}]))


def test_run_lengths_marked_as_a_crowd_are_a_mask_and_said_to_be(tmp_path: Path) -> None:
    for name, given in {"all": [CROWD], "one": [CROWD, {**PLAIN_MASK, "image_id": 1}]}.items():
        source = open_masks(coco(tmp_path / f"{name}.json", given))
        assert np.array_equal(source.read(0).label, square())
        assert source.notes == ["1 marked as crowds (iscrowd) and read as the masks they hold"]


@pytest.mark.parametrize("stroke", [[20, 10, 30, 20], [30, 30], [], [0, 0, 1e9, 1e9]])
@pytest.mark.parametrize("first", [False, True])
def test_polygons_without_an_inside_are_dropped_and_counted(
    stroke: list[float], first: bool, tmp_path: Path
) -> None:
    given = [stroke, polygon()] if first else [polygon(), stroke, stroke]
    frame = open_masks(
        coco(tmp_path / "a.json", [{"image_id": 0, "segmentation": given, "track_id": 1}])
    ).read(0)
    assert np.array_equal(
        frame.label > 0, open_masks(coco(tmp_path / "b.json", [PLAIN_MASK])).read(0).label > 0
    )
    assert frame.left_out == {"polygons of fewer than three points": len(given) - 1}


def test_annotations_without_a_mask_are_left_out_and_counted(tmp_path: Path) -> None:
    box = {"image_id": 0, "segmentation": [], "bbox": [1, 2, 3, 4]}
    source = open_masks(coco(tmp_path / "a.json", [PLAIN_MASK, box, {"image_id": 1}]))
    assert source.left_out == {"annotations without a mask": 2}
    only = open_masks(
        coco(tmp_path / "b.json", [PLAIN_MASK, {"image_id": 0, "segmentation": [[1, 2]]}])
    ).read(0)
    assert only.left_out == {"polygons of fewer than three points": 1, "annotations without a mask": 1}
    assert only.label.max() == 1


def tracks(path: Path, segmentations: dict[int, list[Any]]) -> Path:
    """YouTube-VIS JSON of tracks by their ids."""
    frames = len(next(iter(segmentations.values())))
    about = {"id": 1, "height": SIZE[0], "width": SIZE[1]}
    video = {**about, "name": "disc", "file_names": [f"disc/{t:05d}.jpg" for t in range(frames)]}
    given = [{"id": n, "video_id": 1, "segmentations": masks} for n, masks in segmentations.items()]
    path.write_text(json.dumps({"videos": [video], "annotations": given}))
    return path


NOTHING: dict[str, tuple[Any, bool]] = {
    "shares of the sides": ([[0.1, 0.2, 0.3, 0.2, 0.3, 0.4, 0.1, 0.4]], True),
    "shares in two polygons": ([[0.1, 0.2, 0.3, 0.2, 0.3, 0.4], [0.6, 0.6, 0.7, 0.6, 0.7, 0.8]], True),
    "points of one line": ([[10, 10, 20, 10, 30, 10]], False),
    "smaller than a pixel": ([[10, 10, 10.2, 10, 10.2, 10.2]], False),
    "outside": ([[-30, -30, -20, -30, -20, -20, -30, -20]], False),
    "runs of nothing": ({"size": list(SIZE), "counts": [SIZE[0] * SIZE[1]]}, False),
    "runs of nothing, packed": (runs(np.zeros(SIZE, np.uint8)), False),
}


@pytest.mark.parametrize("kind", NOTHING)
def test_masks_that_cover_no_pixel_are_counted(kind: str, tmp_path: Path) -> None:
    nothing, shares = NOTHING[kind]
    given = [{**PLAIN_MASK, "track_id": 1}, {"image_id": 0, "segmentation": nothing, "track_id": 2}]
    source = open_masks(coco(tmp_path / "a.json", given))
    assert source.read(0).left_out == {"masks that cover no pixel": 1}
    assert [note.split(":")[0] for note in source.notes] == (
        ["1 masks have polygons of coordinates from 0 to 1 only"] if shares else []
    )
    source = open_masks(tracks(tmp_path / "b.json", {1: [[polygon()], [polygon()]], 2: [nothing, nothing]}))
    drawn = isinstance(nothing, list)
    assert source.read(1).left_out == ({"masks that cover no pixel": 1} if drawn else {})
    assert source.left_out == ({} if drawn else {"tracks without a mask in any frame": 1})
    assert len(source.notes) == shares


@pytest.mark.parametrize(
    "masks", [[None, None], [None, []], [[], {"size": list(SIZE), "counts": [SIZE[0] * SIZE[1]]}]]
)
def test_tracks_that_are_nowhere_are_counted(masks: list[Any], tmp_path: Path) -> None:
    seen = [None, [polygon()]]
    source = open_masks(tracks(tmp_path / "a.json", {1: seen, 2: masks, 3: masks}))
    assert source.left_out == {"tracks without a mask in any frame": 2}
    assert source.read(1).label.max() == 1


@pytest.mark.parametrize(
    ("ids", "words"),
    [([1, 2], ""), ([0, 5, 70000], "0 is 1 to 70000 is 3"), ([5], "5 is 1"), ([2, 1], ""), ([1, 3], "1 is 1 to 3 is 2")],
)  # fmt: skip
def test_tracks_that_are_numbered_anew_are_told(ids: list[int], words: str, tmp_path: Path) -> None:
    source = open_masks(tracks(tmp_path / "a.json", {n: [[polygon()]] for n in ids}))
    assert source.notes == ([f"ids numbered in order: {words}"] if words else [])


# ---------------------------------------------------------------------- binary masks
def _blurred(mask: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(mask * np.uint8(255), (0, 0), 3))


def _jpeg(mask: np.ndarray) -> np.ndarray:
    coded = cv2.imencode(".jpg", mask * np.uint8(255), [cv2.IMWRITE_JPEG_QUALITY, 60])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE))


SOFT = {
    "sharp": lambda m: m * np.uint8(255),
    "sharp, 16 bits": lambda m: m * np.uint16(65535),
    "border of one pixel": lambda m: cv2.GaussianBlur(m * np.uint8(255), (3, 3), 0),
    "blurred": _blurred,
    "out of JPEG": _jpeg,
    "enlarged": lambda m: cv2.resize(m[::3, ::3] * np.uint8(255), SIZE[::-1], interpolation=cv2.INTER_LINEAR),
    "turned": lambda m: cv2.warpAffine(m * np.uint8(255), cv2.getRotationMatrix2D((20, 20), 12, 1), SIZE[::-1]),
    "blurred, 16 bits": lambda m: _blurred(m).astype(np.uint16) * 257,
    "probability": lambda m: np.uint8(250 * _blurred(m).astype(float) / 255),
    "probability that is never high": lambda m: np.uint8(120 * _blurred(m).astype(float) / 255),
    "dark, 16 bits": lambda m: np.uint16(20000 * _blurred(m).astype(float) / 255),
}  # fmt: skip


@pytest.mark.parametrize("how", SOFT)
@pytest.mark.parametrize("kind", ["folder", "npy"])
def test_a_mask_of_black_and_white_is_refused_however_soft(how: str, kind: str, tmp_path: Path) -> None:
    images = [SOFT[how](square(t)) for t in range(3)]
    if kind == "npy":
        path = tmp_path / "a.npy"
        np.save(path, np.stack(images))
    else:
        path = tmp_path
        for t, image in enumerate(images):
            Image.fromarray(image).save(path / f"{t:05d}.png")
    with pytest.raises(FormatError, match="a binary mask, where ids are expected"):
        open_masks(path)


def _void(mask: np.ndarray) -> np.ndarray:
    return np.where(cv2.dilate(mask, np.ones((3, 3), np.uint8)) > mask, 255, mask).astype(np.uint8)


def _many(mask: np.ndarray) -> np.ndarray:
    """250 squares that touch, ids without order, the last of them 255."""
    order = np.random.default_rng(0).permutation(np.arange(1, 256))
    return np.asarray(np.kron(order[:192].reshape(12, 16), np.ones((4, 4))), np.uint8)


IDS = {
    "one object": lambda m: m,
    "two objects, one of them 255": lambda m: np.where(m, 255, cv2.dilate(m, np.ones((9, 9), np.uint8))).astype(np.uint8),
    "void around the object": _void,
    "rims of an id of their own": lambda m: np.where(cv2.erode(m, np.ones((3, 3), np.uint8)) < m, 1, 2 * m).astype(np.uint8),
    "rims of 16 ids": lambda m: sum((cv2.erode(m, np.ones((3, 3), np.uint8), iterations=n) for n in range(6)), np.uint8(0) * m),
    "squares that touch": _many,
    "id 255 beside others": lambda m: np.where(m, 255, np.roll(m, 20, 0) * 40).astype(np.uint8),
}  # fmt: skip


@pytest.mark.parametrize("how", IDS)
def test_ids_are_ids_even_where_one_is_255(how: str, tmp_path: Path) -> None:
    images = np.stack([IDS[how](square(t)) for t in range(3)])
    np.save(tmp_path / "a.npy", images)
    source = open_masks(tmp_path / "a.npy")
    assert all(np.array_equal(source.read(t).label, images[t]) for t in range(3))


# ---------------------------------------------------------------------- flow and depth
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e10, -1e10, 1.6e9])
@pytest.mark.parametrize("both", [False, True])
def test_what_is_no_number_or_no_motion_in_a_flo_file_is_unknown(
    value: float, both: bool, tmp_path: Path
) -> None:
    flow = np.ones((2, *SIZE), np.float32)
    flow[slice(0, 2 if both else 1), 3, 4] = value
    stored = np.moveaxis(flow, 0, 2).astype("<f4")
    head = b"PIEH" + np.array(SIZE[::-1], "<i4").tobytes()
    (tmp_path / "00000.flo").write_bytes(head + stored.tobytes())
    found = open_flow(tmp_path).read(0)
    assert np.isnan(found[:, 3, 4]).all()
    found[:, 3, 4] = 1
    assert (found == 1).all()


@pytest.mark.parametrize(
    ("names", "one", "two"),
    [
        (["00000.flo", "00000_fw.flo"], "00000.flo", "00000_fw.flo"),
        (["00000_fw.flo", "00000_forward.flo"], "00000_forward.flo", "00000_fw.flo"),
        (["00000.flo", "00000_bw.flo", "00000-backward.flo"], "00000-backward.flo", "00000_bw.flo"),
        (["forward/00000.flo", "forward/00000_fw.flo"], "00000.flo", "00000_fw.flo"),
    ],
)
def test_two_files_of_one_flow_are_refused(names: list[str], one: str, two: str, tmp_path: Path) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_flo(tmp_path / name, np.zeros((2, *SIZE), np.float32))
    with pytest.raises(FormatError, match=f"{one} and {two} are both the (forward|backward) flow of 00000"):
        open_flow(tmp_path)


@pytest.mark.parametrize("value", [1e300, -1e39, np.inf, np.nan])
def test_depth_of_no_number_of_32_bits_is_unknown(value: float, tmp_path: Path) -> None:
    values = np.full(SIZE, value)
    np.save(tmp_path / "00000.npy", values)
    with pytest.raises(
        FormatError, match=r"no finite number of 32 bits; every frame needs depth: make it anew"
    ):
        open_depth(tmp_path).read(0)
    values[0, 0] = 2
    np.save(tmp_path / "00000.npy", values)
    found = inverse_depth(open_depth(tmp_path).read(0), "depth")
    assert found[0, 0] == 0.5
    assert not (found[1:] > 0).any()


def test_the_number_seven_and_its_text_are_one_object(tmp_path: Path) -> None:
    given = [
        {**PLAIN_MASK, "image_id": n, "track_id": value}
        for n, value in enumerate(["7", 7, 7.0, "7", 9, "10"])
    ]
    source = open_masks(coco(tmp_path / "a.json", given, [f"{t:05d}.png" for t in range(6)]))
    assert [int(source.read(t).label.max()) for t in range(6)] == [7, 7, 7, 7, 9, 10]
    assert not source.notes


@pytest.mark.parametrize("kind", ["pipe", "device", "nothing"])
@pytest.mark.parametrize("option", ["--proposals", "--flow", "--depth"])
def test_what_is_neither_file_nor_folder_is_called_what_it_is(
    kind: str, option: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = "/dev/null" if kind == "device" else str(tmp_path / "given")
    if kind == "pipe":
        os.mkfifo(path)
    is_ = ["--depth-is", "depth"] if option == "--depth" else []
    words = ["import", str(source), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main([*words, option, path, *is_]) == 2
    told = {"pipe": "is a pipe, which can be read only once", "device": "is a device"}
    assert f"{path}: {told.get(kind, 'no such file or folder')}" in capsys.readouterr().err


def test_disparity_has_no_zero_and_nothing_below() -> None:
    values = np.array([[2.0, 0.0, -1.0, np.nan, np.inf, 1e-9]])
    nan = np.nan
    assert np.array_equal(
        inverse_depth(values, "disparity"), np.float32([[2, nan, nan, nan, nan, 1e-9]]), equal_nan=True
    )
    assert np.array_equal(inverse_depth(values, "inverse-depth")[0, :3], [2, 0, -1]), "of networks, it may be"


def _colours() -> np.ndarray:
    ramp = np.tile(np.arange(SIZE[1], dtype=np.uint8) * 4, (SIZE[0], 1))
    return np.asarray(cv2.applyColorMap(ramp, cv2.COLORMAP_INFERNO))


COLOUR = {
    "rgb": lambda: Image.fromarray(_colours()),
    "rgba": lambda: Image.fromarray(np.dstack([_colours(), np.full(SIZE, 255, np.uint8)])),
    "palette": lambda: Image.fromarray(_colours()).convert("P", palette=Image.Palette.ADAPTIVE),
    "16 bits": lambda: cv2.imencode(".png", _colours().astype(np.uint16) * 257)[1].tobytes(),
}


@pytest.mark.parametrize("kind", COLOUR)
def test_depth_in_colour_is_told_to_be_that(kind: str, tmp_path: Path) -> None:
    made, path = COLOUR[kind](), tmp_path / "00000.png"
    path.write_bytes(made) if isinstance(made, bytes) else made.save(path)
    with pytest.raises(
        FormatError, match=r"00000\.png: is in colour, depth painted for the eye; give the depth"
    ):
        open_depth(tmp_path).read(0)


@pytest.mark.parametrize("mode", ["L", "I;16", "RGB", "RGBA", "P"])
def test_grey_depth_is_read_however_it_is_stored(mode: str, tmp_path: Path) -> None:
    ramp = np.tile(np.arange(SIZE[1], dtype=np.uint8) * 3, (SIZE[0], 1))
    image = Image.fromarray(ramp.astype(np.uint16) if mode == "I;16" else ramp)
    (image if mode == "I;16" else image.convert(mode)).save(tmp_path / "00000.png")
    assert np.array_equal(open_depth(tmp_path).read(0), ramp)


# ---------------------------------------------------------------------- the last line of an import
FRAMES = 4


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("source") / "disc", draw_clip(0, FRAMES, *SIZE)[0])


def _strokes(folder: Path) -> Path:
    given = [
        {"image_id": t, "segmentation": [polygon(t), [1, 2, 3, 4]], "attributes": {"track_id": 0}}
        for t in range(FRAMES)
    ]
    return coco(folder / "a.json", [*given, {"image_id": 0, "attributes": {"track_id": 1}}], PADDED[:FRAMES])


def _crowds(folder: Path) -> Path:
    given = [{**CROWD, "image_id": t, "track_id": 1} for t in range(FRAMES)]
    other = {**CROWD, "image_id": FRAMES, "track_id": 2}
    names = [*(f"disc/{t:05d}.png" for t in range(FRAMES)), "cat/00000.png"]
    return coco(folder / "a.json", [*given, other], names)


def _sparse(*ids: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        for t in range(FRAMES):
            label = square(t).astype(np.uint16) * ids[0]
            label[0, : len(ids)] = ids
            Image.fromarray(label).save(folder / f"{t:05d}.png")
        return folder

    return write


def _no_pixel(folder: Path) -> Path:
    shares = [[0.1, 0.2, 0.3, 0.2, 0.3, 0.4, 0.1, 0.4]]
    masks = [[polygon(t)] for t in range(FRAMES)]
    return tracks(folder / "a.json", {1: masks, 2: [shares] * FRAMES, 9: [None] * FRAMES})


def _images(folder: Path) -> Path:
    for t in range(FRAMES):
        Image.fromarray(square(t)).save(folder / f"{t:05d}.png")
    for name in ("readme.txt", ".hidden", "Thumbs.db", "old.jpg"):
        (folder / name).touch()
    return folder


def _flow(folder: Path) -> Path:
    flow = np.zeros((2, *SIZE), np.float32)
    flow[:, : SIZE[0] // 2] = np.nan
    for t in range(FRAMES - 1):
        write_flo(folder / f"{t:05d}.flo", flow)
    (folder / "log.txt").touch()
    return folder


def _kitti(folder: Path) -> Path:
    for t in range(FRAMES):
        (folder / f"{t:05d}.png").write_bytes(encode_kitti(np.zeros((2, *SIZE)), ""))
    return folder


def _disparity(folder: Path) -> Path:
    values = np.ones((FRAMES, *SIZE), np.float32)
    values[:, : SIZE[0] // 4] = -1
    np.save(folder / "a.npy", values)
    return folder / "a.npy"


TOLD = {
    "strokes": ("proposals", _strokes, "left out: annotations without a mask (1), polygons of fewer than three points (4)"),
    "new ids": ("proposals", _strokes, "; ids numbered in order: 0 is 1"),
    "sparse ids": ("proposals", _sparse(7, 300, 65535), "; ids numbered in order: 7 is 1 to 65535 is 3"),
    "ids that can be kept": ("proposals", _sparse(7, 300, 1023), "4 of 4 frames; 0 px hidden below others"),
    "a sparse id": ("proposals", _sparse(5000), "; ids numbered in order: 5000 is 1"),
    "no pixel": ("proposals", _no_pixel, "left out: masks that cover no pixel (4), tracks without a mask in any frame (1); ids numbered in order: 1 is 1 to 9 is 3; 4 masks have polygons of coordinates from 0 to 1 only"),
    "crowds": ("proposals", _crowds, "annotations of other videos (1); 4 marked as crowds (iscrowd)"),
    "files": ("proposals", _images, "masks on 4 of 4 frames; 0 px hidden below others; left out: other files and folders beside them (2)"),
    "flow": ("flow", _flow, "3 pairs, 50.0 % of the pixels unknown; left out: other files and folders beside them (1)"),
    "flow of the last frame": ("flow", _kitti, "3 pairs, 0.0 % of the pixels unknown; left out: entries of frames that are not used (1)"),
    "disparity": ("depth", _disparity, "4 maps, 25.0 % of the pixels unknown"),
}  # fmt: skip


@pytest.mark.parametrize("case", TOLD)
def test_the_last_line_of_an_import_counts_what_was_left_out(
    case: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind, write, words = TOLD[case]
    (tmp_path / "given").mkdir()
    path = write(tmp_path / "given")
    is_ = ["--depth-is", "disparity"] if kind == "depth" else []
    common = [str(source), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main(["import", *common, f"--{kind}", str(path), *is_, "--set", f"frames.width={SIZE[1]}"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith(f"disc: {kind} from")]
    assert words in line


def test_a_run_says_the_same_and_what_an_excerpt_does_not_use(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "given").mkdir()
    words = ["run", str(source), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    cut = ["-o", str(tmp_path / "out"), "--proposals", str(_images(tmp_path / "given")), "--end", "3f"]
    assert main([*words, *cut]) == 0
    assert "entries of frames that are not used (1)" in capsys.readouterr().err


def test_nothing_but_strokes_is_refused_with_their_number(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [{"image_id": 0, "segmentation": [[1, 2, 3, 4]]}, {"image_id": 1, "segmentation": [[5, 6]]}]
    path = coco(tmp_path / "a.json", given)
    words = ["import", str(source), "--store", str(tmp_path / "store"), "--scheduler", "serial"]
    assert main([*words, "--proposals", str(path)]) == 2
    found = capsys.readouterr().err
    assert "has no mask in any of the 4 frames; left out: annotations without a mask (2), polygons" in found
