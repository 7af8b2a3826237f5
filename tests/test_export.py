"""Export: each format is read back by the library of those who use it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr
from conftest import draw_clip, write_folder
from PIL import Image
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from runs import masks, segment

from zsmoseg.formats import find_for_video, open_depth, open_flow, open_masks
from zsmoseg.formats.keep import encode_keep
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.result import Result, open_store
from zsmoseg.workflows.stages.cues.depth import Depth
from zsmoseg.workflows.stages.cues.flow import Flow

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
"""pycocotools' decoder, which only the tests use, is older than numpy 2."""


def flow_of(result: Any) -> Flow:
    return Flow.read(result.artifact("flow"))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of one clip: the last one has depth."""
    root = tmp_path_factory.mktemp("export")
    clip = write_folder(root / "disc", draw_clip()[0])
    segment(clip, root)
    segment(clip, root, {"depth.source": "ground"})
    return root


@pytest.fixture(scope="module")
def result(root: Path) -> Result:
    return open_store(root / "store")["disc"]


def export(root: Path, out: Path, *words: str) -> int:
    return main(["export", "disc", "--store", str(root / "store"), "-o", str(out), "--format", *words])


@pytest.fixture(scope="module")
def painted(root: Path) -> np.ndarray:
    found = masks(root / "out" / "disc")
    assert found.max() == 1
    return found


# ------------------------------------------------------------------ ids
def test_davis_images_are_those_of_the_run(root: Path, tmp_path: Path, painted: np.ndarray) -> None:
    assert export(root, tmp_path, "davis") == 0
    files = sorted((tmp_path / "disc").iterdir())
    assert [f.name for f in files] == [f"{t:05d}.png" for t in range(10)]
    for file, expected in zip(files, painted, strict=True):
        with Image.open(file) as image:
            assert image.mode == "P"
            assert np.array_equal(np.asarray(image), expected)


def test_npz_holds_one_array_as_the_official_evaluator_wants(
    root: Path, tmp_path: Path, painted: np.ndarray
) -> None:
    assert export(root, tmp_path, "npz", "--what", "instance") == 0
    with np.load(tmp_path / "disc.npz") as found:
        assert found.files == ["segmentation"]
        assert np.array_equal(found["segmentation"], painted)


def test_pycocotools_reads_the_coco_file(root: Path, tmp_path: Path, painted: np.ndarray) -> None:
    assert export(root, tmp_path, "coco") == 0
    found = COCO(str(tmp_path / "disc.json"))
    again = np.zeros_like(painted)
    for t, image in enumerate(found.loadImgs(found.getImgIds())):
        assert image["file_name"] == f"disc/{t:05d}.png"
        for annotation in found.loadAnns(found.getAnnIds(image["id"])):
            mask = found.annToMask(annotation)
            again[t] += mask * np.uint8(annotation["track_id"])
            assert annotation["area"] == mask.sum()
            x, y, width, height = map(int, annotation["bbox"])
            assert mask[y : y + height, x : x + width].sum() == mask.sum()
    assert np.array_equal(again, painted)


def test_pycocotools_reads_the_run_lengths_of_the_youtube_vis_file(
    root: Path, tmp_path: Path, painted: np.ndarray
) -> None:
    assert export(root, tmp_path, "ytvis") == 0
    content = json.loads((tmp_path / "disc.json").read_text())
    (video,), tracks = content["videos"], content["annotations"]
    assert video["length"] == len(video["file_names"]) == len(painted)
    again = np.zeros_like(painted)
    for track in tracks:
        for t, segmentation in enumerate(track["segmentations"]):
            if segmentation is not None:
                again[t] += coco_mask.decode(segmentation) * np.uint8(track["id"])
    assert np.array_equal(again, painted)
    source = open_masks(find_for_video(tmp_path, "disc"), "disc")
    assert np.array_equal(source.read("00003").label, painted[3])


def test_pycocotools_reads_the_run_lengths_of_the_mots_file(
    root: Path, tmp_path: Path, painted: np.ndarray
) -> None:
    assert export(root, tmp_path, "mots") == 0
    again = np.zeros_like(painted)
    for line in (tmp_path / "disc.txt").read_text().splitlines():
        frame, number, kind, height, width, counts = line.split(" ")
        rle = {"size": [int(height), int(width)], "counts": counts}
        again[int(frame)] += coco_mask.decode(rle) * np.uint8(int(number) - 1000 * int(kind))
    assert np.array_equal(again, painted)


def test_objects_are_all_labels_and_movers_may_be_painted_only_while_they_move(
    root: Path, tmp_path: Path, result: Result
) -> None:
    assert export(root, tmp_path / "all", "npz", "--what", "object") == 0
    assert export(root, tmp_path / "now", "npz", "--when", "now") == 0
    labels = result.labels.label
    with np.load(tmp_path / "all" / "disc.npz") as found:
        assert np.array_equal(found["segmentation"], labels)
    group, moving = result.groups.group, result.moving()
    with np.load(tmp_path / "now" / "disc.npz") as found:
        for t, frame in enumerate(found["segmentation"]):
            assert np.array_equal(frame, np.where(moving[t], group, 0)[labels[t]])


# ------------------------------------------------------------------ pixels to keep
def test_nerfstudio_masks_are_named_like_the_frames_and_zero_where_something_moves(
    root: Path, tmp_path: Path, painted: np.ndarray
) -> None:
    assert export(root, tmp_path, "nerfstudio") == 0
    for t in range(10):
        mask = cv2.imread(str(tmp_path / "disc" / "masks" / f"{t:05d}.png"), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(mask, np.where(painted[t] > 0, 0, 255))


# ------------------------------------------------------------------ cues
@pytest.mark.parametrize("dilate", [1, 2, 3, 7, 30, 160])
@pytest.mark.parametrize("share", [0.0, 0.0005, 0.02, 1.0])
def test_what_moves_grows_by_a_distance(dilate: int, share: float) -> None:
    moving = np.random.default_rng(dilate).random((70, 90)) < share
    y, x = np.mgrid[:70, :90]
    near = np.zeros_like(moving)
    for row, column in np.argwhere(moving):
        near |= (y - row) ** 2 + (x - column) ** 2 <= dilate**2
    stored = cv2.imdecode(np.frombuffer(encode_keep(moving, dilate), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(stored == 0, near)


def test_opencv_reads_the_flo_files(root: Path, tmp_path: Path, result: Result) -> None:
    assert export(root, tmp_path, "flo") == 0
    for side in ("forward", "backward"):
        stored = getattr(flow_of(result), side)
        for t, flow in enumerate(stored):
            found = cv2.readOpticalFlow(str(tmp_path / "flow" / "disc" / side / f"{t:05d}.flo"))
            assert np.array_equal(np.moveaxis(found, 2, 0), flow)


@pytest.mark.parametrize("format", ["npy", "png"])
def test_cues_are_read_back_by_our_own_readers(
    root: Path, tmp_path: Path, result: Result, format: str
) -> None:
    assert export(root, tmp_path, format, "--cue", "flow", "--cue", "depth") == 0
    flow = open_flow(find_for_video(tmp_path / "flow", "disc"))
    assert (flow.count, flow.has_backward) == (9, True)
    for t in range(9):
        assert np.array_equal(flow.read(t, "forward"), flow_of(result).forward[t])
        assert np.array_equal(flow.read(t, "backward"), flow_of(result).backward[t])
    depth = open_depth(find_for_video(tmp_path / "depth", "disc"))
    stored = Depth.read(result.artifact("depth")).inverse_depth.astype(np.float32)
    scale = stored.max() / 65535 if format == "png" else 1.0
    for t, name in enumerate(result.probe.names):
        assert np.allclose(depth.read(name) * scale, stored[t], atol=scale if format == "png" else 0)


@pytest.mark.parametrize("format", ["netcdf", "zarr"])
def test_xarray_reads_the_copy(
    root: Path, tmp_path: Path, result: Result, painted: np.ndarray, format: str
) -> None:
    assert export(root, tmp_path, format, "--cue", "flow", "--cue", "depth") == 0
    found: Any = (
        xr.open_dataset(tmp_path / "disc.nc", engine="h5netcdf")
        if format == "netcdf"
        else xr.open_zarr(tmp_path / "disc.zarr")
    )
    with found:
        assert np.array_equal(found["mask"], painted)
        assert np.array_equal(found["label"], result.labels.label)
        assert np.array_equal(found["moving"], result.moving())
        assert list(found["name"].values) == list(result.probe.names)
        assert np.array_equal(found["time"], result.probe.times)
        assert found["valid"].all()
        for side in ("forward", "backward"):
            assert np.array_equal(found[side], getattr(flow_of(result), side))
        assert np.array_equal(found["inverse_depth"], Depth.read(result.artifact("depth")).inverse_depth)
        assert found["forward"].sel(pair=3, component="x").dims == ("grid_y", "grid_x")


# ------------------------------------------------------------------ bad input
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("flo", "--what", "instance"), "--what does nothing for flo"),
        (("colmap", "--what", "instance"), "--what does nothing for colmap"),
        (("davis", "--dilate", "3"), "--dilate does nothing for davis"),
        (("davis", "--cue", "flow"), "--cue does nothing for davis"),
        (("png", "--when", "now"), "--when does nothing for png"),
        (("npz", "--what", "object", "--when", "now"), "--when now does nothing for --what object"),
        (("colmap", "--dilate", "-1"), "--dilate -1: must be 0 px or more"),
        (("colmap", "--dilate", "161"), "--dilate 161: disc is 160 x 120; give 160 px or less"),
        (("nerfstudio", "--dilate", "100000"), "--dilate 100000: disc is 160 x 120; give 160 px or less"),
        (("davis", "--run", "none"), "no finished run none of 'disc'"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    assert export(root, tmp_path / "new", *words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_depth_is_refused_where_a_run_has_none(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = sorted((root / "store" / "runs").iterdir())[0].stem
    assert export(root, tmp_path / "new", "npy", "--cue", "flow", "--cue", "depth", "--run", first) == 2
    assert "disc: this run has no depth" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_nothing_is_written_over(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "disc.npz").write_text("mine")
    assert export(root, tmp_path, "npz") == 2
    assert "disc.npz: is there already" in capsys.readouterr().err
    assert (tmp_path / "disc.npz").read_text() == "mine"
    assert export(root, tmp_path / "disc.npz", "npz") == 2
    assert "is a file" in capsys.readouterr().err
    assert export(root, root / "store", "npz") == 2
    assert "is a store" in capsys.readouterr().err


def test_an_export_that_fails_leaves_nothing(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> bool:
        return False

    monkeypatch.setattr(cv2, "writeOpticalFlow", full)
    assert export(root, tmp_path, "flo") == 2
    assert "flow/disc: cannot be written" in capsys.readouterr().err
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []
    assert list((tmp_path / "flow").iterdir()) == []


@pytest.mark.parametrize(
    ("format", "file"), [("npz", "disc.npz"), ("netcdf", "disc.nc"), ("coco", "disc.json")]
)
def test_the_same_export_has_the_same_bytes(root: Path, tmp_path: Path, format: str, file: str) -> None:
    found = set()
    for time in range(3):
        assert export(root, tmp_path / str(time), format) == 0
        found.add((tmp_path / str(time) / file).read_bytes())
    assert len(found) == 1
