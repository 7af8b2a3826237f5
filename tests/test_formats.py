"""Formats: what is written is read back as it was, and what cannot be used is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import SHARED
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from pycocotools import mask as coco

from zsmoseg.errors import FormatError
from zsmoseg.formats import (
    find_for_video,
    inverse_depth,
    match_frames,
    open_depth,
    open_flow,
    open_masks,
    rle,
)
from zsmoseg.formats.coco import encode_coco
from zsmoseg.formats.depth import encode_depth
from zsmoseg.formats.flow_files import encode_kitti, write_flo
from zsmoseg.formats.keep import encode_keep
from zsmoseg.formats.mots import encode_mots
from zsmoseg.formats.npy import write_volume
from zsmoseg.formats.overlaps import stack
from zsmoseg.formats.ytvis import encode_ytvis
from zsmoseg.painting.palette import encode_png

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
"""pycocotools' decoder, which only the tests use, is older than numpy 2."""

SIZE = (12, 17)
NAMES = ["00000", "00001", "00002"]


def draw_labels(seed: int = 0, ids: int = 4) -> np.ndarray:
    """Three frames of ids, each id in each frame."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, ids + 1, (len(NAMES), *SIZE)).astype(np.uint16)
    labels[:, 0, : ids + 1] = np.arange(ids + 1)
    return labels


def draw_flow(seed: int = 0, pairs: int = 2) -> np.ndarray:
    """(pairs, 2, H, W) in steps of 1/64 px."""
    rng = np.random.default_rng(seed)
    return (rng.integers(-6400, 6400, (pairs, 2, *SIZE)) / 64).astype(np.float32)


def write_pngs(folder: Path, labels: np.ndarray) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, label in zip(NAMES, labels, strict=False):
        (folder / f"{name}.png").write_bytes(encode_png(label))
    return folder


def square(y: int, x: int, side: int) -> np.ndarray:
    mask = np.zeros(SIZE, bool)
    mask[y : y + side, x : x + side] = True
    return mask


def read_all(path: Path) -> None:
    source = open_masks(path, "goat")
    for t in range(source.count):
        source.read(t)


def write_json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def coco_content(annotations: list[dict[str, Any]], files: list[str] | None = None) -> dict[str, Any]:
    images = [
        {"id": i, "file_name": name, "height": SIZE[0], "width": SIZE[1]}
        for i, name in enumerate(files or ["00000.jpg", "00001.jpg"])
    ]
    numbered = [{"id": k, "image_id": 0, "category_id": 1, **a} for k, a in enumerate(annotations)]
    return {"images": images, "annotations": numbered, "categories": []}


def ytvis_content(tracks: list[dict[str, Any]], video: str = "goat") -> dict[str, Any]:
    shape = {"height": SIZE[0], "width": SIZE[1], "length": 2}
    files = [f"{video}/00000.jpg", f"{video}/00001.jpg"]
    return {
        "videos": [{"id": 7, "file_names": files, **shape}],
        "annotations": [{"video_id": 7, "category_id": 1, **t} for t in tracks],
        "categories": [],
    }


# ------------------------------------------------------------------ names
def test_a_video_is_found_by_its_name_or_is_the_path_itself(tmp_path: Path) -> None:
    folder = write_pngs(tmp_path / "all" / "goat", draw_labels())
    file = tmp_path / "all" / "libby.npz"
    np.savez(file, labels=draw_labels())
    assert find_for_video(tmp_path / "all", "goat") == folder
    assert find_for_video(tmp_path / "all", "libby") == file
    assert find_for_video(folder, "goat") == folder
    assert find_for_video(file, "anything") == file
    (tmp_path / "flow" / "forward").mkdir(parents=True)
    assert find_for_video(tmp_path / "flow", "goat") == tmp_path / "flow"


def test_what_was_looked_for_is_said_where_no_video_or_two_are_found(tmp_path: Path) -> None:
    (tmp_path / "goat").mkdir()
    with pytest.raises(FormatError, match=r"holds no libby, libby\.npz, libby\.npy, libby\.json"):
        find_for_video(tmp_path, "libby")
    (tmp_path / "goat.json").touch()
    with pytest.raises(FormatError, match=r"holds goat and goat\.json"):
        find_for_video(tmp_path, "goat")
    with pytest.raises(FormatError, match="no such file"):
        find_for_video(tmp_path / "none", "goat")
    with pytest.raises(FormatError, match="leaves the folder"):
        find_for_video(tmp_path, "../goat")


@pytest.mark.parametrize(
    ("entries", "frames", "expected"),
    [
        (["00001", "00000"], ["00000", "00001"], [1, 0]),
        (["mask12", "mask3"], ["00003", "00004", "00012"], [1, None, 0]),
        (["a_2"], ["2", "a_2"], [None, 0]),
        (3, ["a", "b", "c"], [0, 1, 2]),
        (range(2), ["a", "b", "c"], [0, 1, None]),
    ],
)
def test_entries_belong_to_frames_by_name_then_integer_then_order(
    entries: Any, frames: list[str], expected: list[int | None]
) -> None:
    assert match_frames(entries, frames) == expected


@pytest.mark.parametrize(
    ("entries", "frames", "message"),
    [
        (["00009"], ["00000", "00001"], "here: 00009 belongs to no frame"),
        (["mean"], ["00000"], "mean belongs to no frame"),
        (["f1", "00001"], ["00000", "00001"], "f1 and 00001 both belong to frame 00001"),
        (["2"], ["a_2", "b_2"], "2 belongs to no frame"),
        (2, ["a", "b", "c"], "2 entries without names for 3 frames"),
        (range(4), ["a", "b", "c"], "frame 3 is beyond the last"),
    ],
)
def test_an_entry_of_no_frame_is_named_never_guessed(entries: Any, frames: list[str], message: str) -> None:
    with pytest.raises(FormatError, match=message):
        match_frames(entries, frames, "here")


# ------------------------------------------------------------------ masks with ids
def test_ids_survive_palette_grey_and_16_bit_png(tmp_path: Path) -> None:
    labels = draw_labels(ids=4)
    labels[2, 3, 3] = 40000
    write_pngs(tmp_path, labels)
    Image.fromarray(labels[1].astype(np.uint8)).save(tmp_path / "00001.png")
    source = open_masks(tmp_path)
    assert (source.frames, source.ids, source.size, source.count) == (NAMES, True, SIZE, 3)
    for t, name in enumerate(NAMES):
        for entry in (t, name):
            found = source.read(entry)
            assert np.array_equal(found.label, labels[t])
            assert (found.label.dtype, found.hidden, found.score) == (np.uint16, 0, None)


def test_the_official_npz_is_read_in_any_order_and_written_the_same_each_time(tmp_path: Path) -> None:
    labels = draw_labels()
    for name in ("a.npz", "b.npz"):
        write_volume(tmp_path / name, "segmentation", iter(labels), labels.shape, "uint16")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as found:
        assert found.files == ["segmentation"]
        assert np.array_equal(found["segmentation"], labels)
    np.savez_compressed(tmp_path / "c.npz", labels=np.asfortranarray(labels, np.int64))
    np.save(tmp_path / "d.npy", labels.astype(np.int32))
    for name in ("a.npz", "c.npz", "d.npy"):
        source = open_masks(tmp_path / name)
        assert (source.frames, source.ids, source.entries) == (None, True, 3)
        for t in (2, 0, 1):
            assert np.array_equal(source.read(t).label, labels[t])


def _one_of_other_size(folder: Path) -> Path:
    write_pngs(folder, draw_labels())
    (folder / "00001.png").write_bytes(encode_png(np.ones((5, 6), np.uint16)))
    return folder


def _colours(folder: Path) -> Path:
    write_pngs(folder, draw_labels())
    Image.fromarray(np.full((*SIZE, 3), (0, 1, 2), np.uint8)).save(folder / "00001.png")
    return folder


def _binary(folder: Path) -> Path:
    return write_pngs(folder, np.stack([np.zeros(SIZE, np.uint16), *[square(2, 2, 4) * np.uint16(255)] * 2]))


def _cut_short(folder: Path) -> Path:
    write_pngs(folder, draw_labels())
    file = folder / "00001.png"
    file.write_bytes(file.read_bytes()[:-60])
    return folder


def _volume(values: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        folder.mkdir()
        np.savez(folder / "goat.npz", labels=values)
        return folder / "goat.npz"

    return write


def _cut_npz(folder: Path) -> Path:
    file = _volume(draw_labels())(folder)
    file.write_bytes(file.read_bytes()[:-300])
    return file


def _two_arrays(folder: Path) -> Path:
    folder.mkdir()
    np.savez(folder / "goat.npz", a=draw_labels(), b=draw_labels())
    return folder / "goat.npz"


def _empty(folder: Path) -> Path:
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (_one_of_other_size, r"00001\.png: is 5 x 6, 00000\.png 12 x 17"),
        (_colours, r"00001\.png: is a colour image; ids are expected"),
        (_binary, r"00001\.png: holds only 0 and 255"),
        (_cut_short, r"00001\.png: cannot be read"),
        (_volume(draw_labels().astype(np.int64) + 65535), r"goat\.npz, frame 0: holds the id 65539"),
        (_volume(draw_labels().astype(np.int64) - 1), r"goat\.npz, frame 0: holds the id -1"),
        (_volume(draw_labels().astype(float)), r"goat\.npz, frame 0: holds float64 numbers"),
        (_volume((draw_labels() > 2) * np.uint8(255)), r"goat\.npz, frame 0: holds only 0 and 255"),
        (_volume(draw_labels()[0]), r"goat\.npz: the array is 12 x 17"),
        (_volume(np.array([{}])), r"goat\.npz: cannot be read"),
        (_cut_npz, r"goat\.npz: cannot be read"),
        (_two_arrays, r"goat\.npz: holds a, b"),
        (_empty, "holds neither PNG"),
        (lambda folder: folder, "no such file or folder"),
    ],
)
def test_masks_that_cannot_be_used_are_named(
    tmp_path: Path, write: Callable[[Path], Path], message: str
) -> None:
    path = write(tmp_path / "given")
    with pytest.raises(FormatError, match=message):
        read_all(path)


# ------------------------------------------------------------------ masks that overlap
@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.booleans())
def test_the_higher_score_or_the_smaller_mask_is_on_top_and_what_is_hidden_is_counted(
    seed: int, count: int, scored: bool
) -> None:
    rng = np.random.default_rng(seed)
    masks = list(rng.random((count, 4, 5)) < rng.random((count, 1, 1)))
    scores = rng.random(count).tolist() if scored else None
    found = stack(masks, (4, 5), scores=scores)
    hidden = 0
    for y, x in np.ndindex(4, 5):
        on = [k for k in range(count) if masks[k][y, x]]
        rank = {k: (scores[k], -k) if scores else (-masks[k].sum(), -k) for k in on}
        assert found.label[y, x] == (1 + max(on, key=lambda k: rank[k]) if on else 0)
        hidden += max(len(on) - 1, 0)
    assert found.hidden == hidden
    assert (found.score is None) == (scores is None)


def test_detections_are_unpacked_by_frame_and_frames_without_any_are_empty(tmp_path: Path) -> None:
    masks = np.stack([square(1, 1, 5), square(3, 3, 4), square(0, 0, 2)])
    np.savez(
        tmp_path / "goat.npz",
        frame=np.array([0, 0, 2]),
        score=np.float32([0.9, 0.4, 0.7]),
        packed=np.packbits(masks.reshape(3, -1), axis=1),
        size=np.array(SIZE),
    )
    source = open_masks(tmp_path / "goat.npz")
    assert (source.frames, source.ids, source.count, source.entries) == (None, False, 3, range(3))
    first = source.read(0)
    assert np.array_equal(first.label == 1, masks[0])
    assert np.array_equal(first.label == 2, masks[1] & ~masks[0])
    assert first.hidden == (masks[0] & masks[1]).sum()
    assert first.score is not None
    assert first.score.tolist() == np.float32([0.9, 0.4]).tolist()
    assert not source.read(1).label.any()
    assert np.array_equal(source.read(2).label > 0, masks[2])


def test_packed_masks_of_another_size_and_scores_of_another_count_are_named(tmp_path: Path) -> None:
    packed, shape = np.zeros((2, 9), np.uint8), np.array([2, *SIZE])
    np.savez(tmp_path / "proposals_1.npz", packed=packed, shape=shape)
    with pytest.raises(FormatError, match=r"proposals_1\.npz: rows of 9 bytes"):
        open_masks(tmp_path).read("1")
    right = np.zeros((2, (SIZE[0] * SIZE[1] + 7) // 8), np.uint8)
    np.savez(tmp_path / "proposals_1.npz", packed=right, shape=shape, score=np.ones(3))
    with pytest.raises(FormatError, match=r"proposals_1\.npz: has 2 masks and 3 scores"):
        open_masks(tmp_path).read("1")


@pytest.fixture(scope="module")
def proposals() -> Path:
    folder = SHARED / "proposals"
    if not folder.is_dir():
        pytest.skip("the proposals of others are not beside the checkout")
    return folder


def test_real_proposals_of_every_kind_are_read(proposals: Path) -> None:
    rvos = open_masks(find_for_video(proposals / "rvos", "goat"))
    assert rvos.ids
    assert 1 <= rvos.read("00000").label.max() <= 20
    detections = proposals / "yolov8n-seg" / "detections"
    yolo = open_masks(find_for_video(detections, "goat"))
    with np.load(detections / "goat.npz") as found:
        first = np.unpackbits(found["packed"][found["frame"] == 0], axis=1)[:, : 480 * 854].any(0)
    assert not yolo.ids
    assert np.array_equal(yolo.read(0).label > 0, first.reshape(480, 854))
    damaged = open_masks(find_for_video(proposals / "damaged", "goat"))
    with np.load(proposals / "damaged" / "goat.npz") as found:
        assert np.array_equal(damaged.read(7).label, found["labels"][7])
    forest = open_masks(proposals / "sharpmask-forest")
    assert forest.frames == ["00001", "00002", "00003", "00004"]
    masks = forest.read("00001")
    assert masks.score is not None
    assert masks.hidden > np.count_nonzero(masks.label)
    assert masks.label.max() <= len(masks.score) == 100


# ------------------------------------------------------------------ COCO, YouTube-VIS, MOTS
def drawn(segmentation: Any) -> np.ndarray:
    mask, strokes = rle.decode(segmentation, SIZE, "")
    assert mask is not None
    assert not strokes
    return mask


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_run_lengths_are_those_of_pycocotools(seed: int, share: float) -> None:
    mask = np.random.default_rng(seed).random(SIZE) < share
    found = rle.encode(mask)
    assert np.array_equal(coco.decode({**found, "counts": found["counts"].encode()}), mask)
    assert np.array_equal(drawn(found), mask)
    runs = rle.run_lengths(found["counts"].encode())
    assert np.array_equal(drawn({"size": list(SIZE), "counts": runs}), mask)
    assert rle.area(found) == mask.sum()


def test_polygons_are_read_as_pycocotools_draws_them(tmp_path: Path) -> None:
    polygon = [[2.0, 1.0, 9.0, 1.0, 9.0, 8.0, 2.0, 8.0]]
    source = open_masks(write_json(tmp_path / "a.json", coco_content([{"segmentation": polygon}])))
    drawn = coco.decode(coco.merge(coco.frPyObjects(polygon, *SIZE)))
    assert drawn.sum() == 49
    assert np.array_equal(source.read("00000").label, drawn)


def test_coco_without_ids_numbers_the_masks_of_a_frame_crowds_like_others(tmp_path: Path) -> None:
    big, small = square(1, 1, 6), square(2, 2, 2)
    given = [{"segmentation": rle.encode(big)}, {"segmentation": rle.encode(small)}]
    crowd = {"segmentation": rle.encode(square(8, 8, 3)), "iscrowd": 1}
    source = open_masks(write_json(tmp_path / "a.json", coco_content([*given, crowd])))
    assert (source.frames, source.ids, source.size) == (["00000", "00001"], False, SIZE)
    first = source.read(0)
    assert np.array_equal(first.label, np.select([small, big, square(8, 8, 3)], [2, 1, 3], 0))
    assert source.notes == ["1 marked as crowds (iscrowd) and read as the masks they hold"]
    assert first.hidden == small.sum()
    assert not source.read(1).label.any()
    scored = [{**given[0], "score": 0.9}, {**given[1], "score": 0.1}]
    first = open_masks(write_json(tmp_path / "b.json", coco_content(scored))).read(0)
    assert np.array_equal(first.label, big)


def test_coco_with_track_ids_keeps_them_and_a_folder_chooses_the_video(tmp_path: Path) -> None:
    files = ["goat/00000.jpg", "libby/00000.jpg"]
    tracks = [
        {"segmentation": rle.encode(square(1, 1, 3)), "track_id": 9},
        {"segmentation": rle.encode(square(5, 5, 3)), "track_id": 4, "image_id": 1},
    ]
    path = write_json(tmp_path / "a.json", coco_content(tracks, files))
    for video, number in (("goat", 9), ("libby", 4)):
        source = open_masks(path, video)
        assert (source.ids, source.count) == (True, 1)
        assert source.read("00000").label.max() == number
    with pytest.raises(FormatError, match=r"holds 2 videos \(goat, libby\), not one called dog"):
        open_masks(path, "dog")


@pytest.mark.parametrize("encode", ["coco", "ytvis"])
def test_ids_survive_json(tmp_path: Path, encode: str) -> None:
    labels, files = draw_labels(), [f"goat/{name}.jpg" for name in NAMES]
    content = (
        encode_coco(files, labels, SIZE) if encode == "coco" else encode_ytvis("goat", files, labels, SIZE)
    )
    (tmp_path / "goat.json").write_bytes(content)
    source = open_masks(tmp_path / "goat.json", "a-goat")
    assert (source.frames, source.ids) == (NAMES, True)
    for t in range(len(NAMES)):
        assert np.array_equal(source.read(t).label, labels[t])


def test_tracks_are_numbered_in_order_of_their_ids_and_missing_where_null(tmp_path: Path) -> None:
    tracks = [
        {"id": 30, "segmentations": [rle.encode(square(1, 1, 3)), None], "score": 0.5},
        {"id": 20, "segmentations": [rle.encode(square(2, 2, 4)), rle.encode(square(6, 6, 2))], "score": 0.4},
    ]
    source = open_masks(write_json(tmp_path / "a.json", ytvis_content(tracks)), "goat")
    first, second = source.read("00000"), source.read("00001")
    assert first.hidden == 4
    assert np.array_equal(first.label == 2, square(1, 1, 3))
    assert np.array_equal(second.label, square(6, 6, 2))
    assert first.score is not None
    assert first.score.tolist() == np.float32([0.4, 0.5]).tolist()


def test_the_name_or_the_folder_of_its_files_chooses_one_of_several_videos(tmp_path: Path) -> None:
    content = ytvis_content([{"id": 1, "segmentations": [rle.encode(square(1, 1, 3)), None]}])
    other = {**content["videos"][0], "id": 8, "name": "a/libby"}
    content["videos"].append(other)
    path = write_json(tmp_path / "a.json", content)
    assert open_masks(path, "goat").read(0).label.any()
    assert not open_masks(path, "a-libby").read(0).label.any()
    with pytest.raises(FormatError, match=r"a\.json: holds 2 videos \(a/libby, goat\); name the video"):
        open_masks(path)


SOME = rle.encode(square(1, 1, 3))
OTHER = rle.encode(np.ones((5, 6), bool))
CUT = {**SOME, "counts": SOME["counts"][:-1]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([1], "is neither COCO"),
        ({"labels": []}, "is neither COCO"),
        ({"images": []}, "has no 'annotations'|holds no images"),
        ({"images": {}, "annotations": []}, "'images' is dict"),
        (
            coco_content([{"segmentation": OTHER}]),
            r"00000\.jpg, annotation 0: the run lengths are of \[5, 6\]",
        ),
        (coco_content([{"segmentation": CUT}]), r"00000\.jpg, annotation 0: the segmentation is damaged"),
        (
            coco_content([{"segmentation": {"size": list(SIZE), "counts": [3]}}]),
            "the runs make 3 of 204 pixels",
        ),
        (coco_content([{"segmentation": [[1, 2, 3]]}]), "annotation 0: the segmentation is damaged"),
        (coco_content([{"segmentation": {}}]), "annotation 0: the segmentation is neither"),
        (coco_content([{}, {"segmentation": []}]), "none of its 2 annotations has a mask"),
        ([{"image_id": 1, "segmentation": SOME}], "a list of results, which names no images"),
        (coco_content([{"image_id": "x"}]), "annotation 0: 'image_id' is str"),
        (coco_content([{"id": 3}, {"id": 3}]), "two annotations have the id 3"),
        (coco_content([], ["../00000.jpg"]), r"the name '\.\./00000\.jpg' leaves the folder"),
        (coco_content([], ["/etc/00000.jpg"]), "leaves the folder"),
        (coco_content([], ["a\\..\\..\\00000.jpg"]), "leaves the folder"),
        (coco_content([{"segmentation": SOME, "track_id": 1}, {"segmentation": SOME}]), "1 of 2 annotations"),
        (coco_content([{"segmentation": SOME, "track_id": 1.5}]), "annotation 0: track_id is 1.5"),
        (coco_content([{"segmentation": SOME, "track_id": [1]}]), r"annotation 0: track_id is \[1\]"),
        (coco_content([{"segmentation": SOME, "track_id": ""}]), "annotation 0: track_id is empty"),
        (
            coco_content([{"segmentation": SOME, "track_id": 2}] * 2),
            r"00000\.jpg: annotations 0 and 1 have one id",
        ),
        (ytvis_content([], "../goat"), "leaves the folder"),
        (
            ytvis_content([{"id": 1, "segmentations": [SOME]}]),
            "annotation 1: has 1 segmentations for 2 frames",
        ),
        (ytvis_content([{"id": 1, "segmentations": [OTHER, None]}]), "00000, annotation 1: the run lengths"),
        (ytvis_content([{"id": 1}]), "annotation 1: has no 'segmentations'"),
    ],
)
def test_json_that_cannot_be_used_is_named(tmp_path: Path, content: Any, message: str) -> None:
    path = write_json(tmp_path / "a.json", content)
    with pytest.raises(FormatError, match=message) as caught:
        read_all(path)
    assert "a.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_images_of_two_sizes_and_what_is_no_json_are_named(tmp_path: Path) -> None:
    content = coco_content([])
    content["images"][1]["width"] = 99
    with pytest.raises(FormatError, match=r"00001\.jpg: is 12 x 99, 00000\.jpg 12 x 17"):
        open_masks(write_json(tmp_path / "a.json", content))
    (tmp_path / "b.json").write_text("{")
    with pytest.raises(FormatError, match=r"b\.json: cannot be read"):
        open_masks(tmp_path / "b.json")


def test_mots_lines_hold_every_object_of_every_frame() -> None:
    labels = draw_labels()
    found = np.zeros_like(labels)
    for line in encode_mots(labels).decode().splitlines():
        frame, number, kind, height, width, counts = line.split(" ")
        mask = coco.decode({"size": [int(height), int(width)], "counts": counts.encode()})
        assert int(number) // 1000 == int(kind)
        found[int(frame)] += (mask * (int(number) % 1000)).astype(np.uint16)
    assert np.array_equal(found, labels)
    with pytest.raises(FormatError, match="object 1000"):
        encode_mots([np.full(SIZE, 1000)])


@pytest.mark.parametrize("dilate", [0, 3])
def test_pixels_to_keep_are_those_farther_than_the_dilation_from_what_moves(dilate: int) -> None:
    moving = square(4, 5, 3)
    found = cv2.imdecode(np.frombuffer(encode_keep(moving, dilate), np.uint8), cv2.IMREAD_UNCHANGED)
    points = np.argwhere(moving)
    away = np.linalg.norm(np.argwhere(np.ones(SIZE))[:, None] - points, axis=2).min(1).reshape(SIZE)
    assert np.array_equal(found, np.where(away <= dilate, 0, 255))


# ------------------------------------------------------------------ flow
def _write_flow(folder: Path, ending: str, flow: np.ndarray, end: str = "") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for t, one in enumerate(flow):
        path = folder / f"{t:05d}{end}{ending}"
        if ending == ".flo":
            write_flo(path, one)
        elif ending == ".png":
            path.write_bytes(encode_kitti(one, ""))
        elif ending == ".npy":
            np.save(path, np.moveaxis(one, 0, 2))
        else:
            np.savez(
                path, flow=one.astype(np.float16 if np.array_equal(one, one.astype(np.float16)) else float)
            )


@pytest.mark.parametrize("ending", [".flo", ".png", ".npy", ".npz"])
@pytest.mark.parametrize("layout", ["folders", "ends", "forward only"])
def test_flow_is_read_back_from_every_format_and_layout(tmp_path: Path, ending: str, layout: str) -> None:
    there, back = draw_flow(0), draw_flow(1)
    if layout == "folders":
        _write_flow(tmp_path / "forward", ending, there)
        _write_flow(tmp_path / "backward", ending, back)
    elif layout == "ends":
        _write_flow(tmp_path, ending, there, "_fw")
        _write_flow(tmp_path, ending, back, "_bw")
    else:
        _write_flow(tmp_path, ending, there)
    source = open_flow(tmp_path)
    assert (source.frames, source.count) == (["00000", "00001"], 2)
    assert source.has_backward == (layout != "forward only")
    for t, name in enumerate(["00000", "00001"]):
        found = source.read(name, "forward")
        assert found.dtype == np.float32
        assert np.array_equal(found, there[t])
        if source.has_backward:
            assert np.array_equal(source.read(t, "backward"), back[t])
    if not source.has_backward:
        with pytest.raises(FormatError, match="has no backward flow"):
            source.read(0, "backward")


@pytest.mark.parametrize("last", [False, True])
def test_flow_of_a_whole_video_is_read_from_one_file(tmp_path: Path, last: bool) -> None:
    there, back = draw_flow(0), draw_flow(1)
    given = [np.moveaxis(f, 1, 3) if last else f for f in (there, back)]
    np.savez(tmp_path / "both.npz", forward=given[0], backward=given[1])
    np.savez(tmp_path / "one.npz", flow=given[0])
    np.save(tmp_path / "one.npy", given[0])
    for name in ("both.npz", "one.npz", "one.npy"):
        source = open_flow(tmp_path / name)
        assert (source.frames, source.count, source.has_backward) == (None, 2, name == "both.npz")
        assert np.array_equal(source.read(1, "forward"), there[1])
        if source.has_backward:
            assert np.array_equal(source.read(0, "backward"), back[0])


def test_backward_files_may_be_called_after_the_second_frame(tmp_path: Path) -> None:
    there, back = draw_flow(0, 3), draw_flow(1, 3)
    _write_flow(tmp_path / "forward", ".npy", there)
    _write_flow(tmp_path / "backward", ".npy", np.concatenate([back[:1], back]))
    (tmp_path / "backward" / "00000.npy").unlink()
    assert np.array_equal(open_flow(tmp_path).read("00000", "backward"), back[0])
    (tmp_path / "backward" / "00003.npy").unlink()
    with pytest.raises(FormatError, match="00000 has flow in one direction only"):
        open_flow(tmp_path)


@pytest.mark.parametrize("ending", [".flo", ".png"])
def test_unknown_flow_is_nan(tmp_path: Path, ending: str) -> None:
    flow = draw_flow(0, 1)
    flow[0, :, 3, 4] = np.nan
    _write_flow(tmp_path, ending, flow)
    assert np.array_equal(open_flow(tmp_path).read(0), flow[0], equal_nan=True)


def _nan(ending: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        flow = draw_flow(0)
        flow[1, 0, 0, 0] = np.nan
        _write_flow(folder, ending, flow)

    return write


def _small(folder: Path) -> None:
    _write_flow(folder, ".npy", draw_flow())
    np.save(folder / "00001.npy", draw_flow()[0, :, :5])


def _cut_flo(folder: Path) -> None:
    _write_flow(folder, ".flo", draw_flow())
    (folder / "00001.flo").write_bytes((folder / "00001.flo").read_bytes()[:99])


def _eight_bits(folder: Path) -> None:
    _write_flow(folder, ".png", draw_flow())
    cv2.imwrite(str(folder / "00001.png"), np.zeros((*SIZE, 3), np.uint8))


def _whole_numbers(folder: Path) -> None:
    _write_flow(folder, ".npy", draw_flow())
    np.save(folder / "00001.npy", np.zeros((2, *SIZE), int))


def _no_flow(folder: Path) -> None:
    _write_flow(folder, ".npy", draw_flow())
    np.save(folder / "00001.npy", np.zeros((3, *SIZE)))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (_nan(".npy"), r"00001\.npy: holds NaN"),
        (_nan(".npz"), r"00001\.npz: holds NaN"),
        (_small, r"00001\.npy: is 5 x 17, the first 12 x 17"),
        (_cut_flo, r"00001\.flo: is damaged"),
        (_eight_bits, r"00001\.png: is no flow as KITTI has it"),
        (_whole_numbers, r"00001\.npy: holds int64 numbers"),
        (_no_flow, r"00001\.npy: is 3 x 12 x 17; flow is"),
        (lambda folder: folder.mkdir(), "holds no forward flow"),
    ],
)
def test_flow_that_cannot_be_used_is_named(
    tmp_path: Path, write: Callable[[Path], None], message: str
) -> None:
    write(tmp_path / "flow")
    with pytest.raises(FormatError, match=message):
        open_flow(tmp_path / "flow").read(1)


def test_flow_too_large_for_kitti_is_refused() -> None:
    with pytest.raises(FormatError, match=r"frame 7: a pixel moves by 600 px"):
        encode_kitti(np.full((2, *SIZE), 600.0), "frame 7")


def test_real_flow_is_read_from_its_published_files(tmp_path: Path) -> None:
    if not (SHARED / "flow").is_dir():
        pytest.skip("the flow of others is not beside the checkout")
    shutil.copy(SHARED / "flow" / "flyingchairs" / "00001_flow.flo", tmp_path)
    chairs = open_flow(tmp_path)
    assert (chairs.frames, chairs.has_backward) == (["00001_flow"], False)
    assert chairs.read(0).shape == (2, 384, 512)
    sintel = open_flow(SHARED / "flow" / "pwcnet-sintel" / "flow.npz")
    assert (sintel.count, sintel.has_backward) == (1, True)
    with np.load(SHARED / "flow" / "pwcnet-sintel" / "flow.npz") as found:
        assert np.array_equal(sintel.read(0, "backward")[1], found["backward"][..., 1])


# ------------------------------------------------------------------ depth
@pytest.mark.parametrize("ending", [".png", ".npy", ".npz"])
def test_depth_is_read_as_stored(tmp_path: Path, ending: str) -> None:
    maps = np.random.default_rng(0).integers(0, 65536, (3, *SIZE)).astype(np.uint16)
    for name, values in zip(NAMES, maps, strict=True):
        if ending == ".png":
            cv2.imwrite(str(tmp_path / f"{name}.png"), values)
        elif ending == ".npy":
            np.save(tmp_path / f"{name}.npy", values.astype(np.float32))
        else:
            np.savez(tmp_path / f"{name}.npz", depth=values.astype(float))
    source = open_depth(tmp_path)
    assert (source.frames, source.count) == (NAMES, 3)
    for t, name in enumerate(NAMES):
        found = source.read(name)
        assert found.dtype == np.float32
        assert np.array_equal(found, maps[t])


@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_depth_of_a_whole_video_is_read_from_one_file(tmp_path: Path, ending: str) -> None:
    maps = np.random.default_rng(0).random((3, *SIZE)).astype(np.float32)
    path = tmp_path / f"goat{ending}"
    if ending == ".npy":
        np.save(path, maps)
    else:
        np.savez_compressed(path, depth=maps)
    source = open_depth(path)
    assert (source.frames, source.count) == (None, 3)
    assert np.array_equal(source.read(2), maps[2])


def test_inverse_depth_is_one_over_depth_and_unknown_where_there_is_none() -> None:
    values = np.array([[2.0, 0.0, -1.0, np.nan, np.inf]])
    nan = np.nan
    assert np.array_equal(
        inverse_depth(values, "depth"), np.float32([[0.5, nan, nan, nan, 0]]), equal_nan=True
    )
    kept = np.float32([[2, 0, -1, nan, nan]])
    assert np.array_equal(inverse_depth(values, "inverse-depth"), kept, equal_nan=True)


def test_depth_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "00000.npy", np.ones(SIZE))
    for values, message in (
        (np.ones((5, 6)), r"00001\.npy: is 5 x 6, the first 12 x 17"),
        (np.ones((*SIZE, 3)), r"00001\.npy: is 12 x 17 x 3 float64; depth is one number"),
        (np.full(SIZE, np.nan), r"00001\.npy: holds no finite number"),
    ):
        np.save(tmp_path / "00001.npy", values)
        with pytest.raises(FormatError, match=message):
            open_depth(tmp_path).read("00001")
    (tmp_path / "00002.png").touch()
    with pytest.raises(FormatError, match="holds files of several kinds"):
        open_depth(tmp_path)
    (tmp_path / "exr").mkdir()
    (tmp_path / "exr" / "00000.exr").write_bytes(b"no image")
    with pytest.raises(
        FormatError, match=r"00000\.exr: cannot be read .is no OpenEXR file.; convert it to \.npy"
    ):
        open_depth(tmp_path / "exr").read(0)


def test_depth_png_holds_the_ratio_of_inverse_depths(tmp_path: Path) -> None:
    inverse = np.random.default_rng(0).random(SIZE).astype(np.float32)
    (tmp_path / "00000.png").write_bytes(encode_depth(inverse, float(inverse.max())))
    found = open_depth(tmp_path).read(0)
    assert found.max() == 65535
    assert np.allclose(found / 65535 * inverse.max(), inverse, atol=0.5 / 65535)
