"""Masks, flow and depth as other people's tools write them: what is taken, what is refused, what is counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from zsmoseg.errors import FormatError
from zsmoseg.formats import match_frames, open_masks

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
    "squares that touch": _many,
    "id 255 beside others": lambda m: np.where(m, 255, np.roll(m, 20, 0) * 40).astype(np.uint8),
}  # fmt: skip


@pytest.mark.parametrize("how", IDS)
def test_ids_are_ids_even_where_one_is_255(how: str, tmp_path: Path) -> None:
    images = np.stack([IDS[how](square(t)) for t in range(3)])
    np.save(tmp_path / "a.npy", images)
    source = open_masks(tmp_path / "a.npy")
    assert all(np.array_equal(source.read(t).label, images[t]) for t in range(3))
