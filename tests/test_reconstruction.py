"""Masks for COLMAP and nerfstudio lie on the stored pixels of the images, and are called as both look for them."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_mp4
from PIL import Image
from runs import segment

from zsmoseg.painting.palette import encode_png
from zsmoseg.video.orientation import as_stored
from zsmoseg.workflows.cli import main

FRAMES, SIZE = 4, (96, 128)
ORIENTATION = 0x0112

COLMAP = """
import json, sys
import cv2  # first: its libpng and that of COLMAP do not agree the other way round
import pycolmap
images, masks, database, names = json.loads(sys.argv[1])
pycolmap.logging.minloglevel = 3
options = pycolmap.ImageReaderOptions()
if masks:
    options.mask_path = masks
pycolmap.extract_features(
    database,
    images,
    image_names=names,
    reader_options=options,
    extraction_options=pycolmap.FeatureExtractionOptions(num_threads=1, use_gpu=False),
    device=pycolmap.Device.cpu,
)
with pycolmap.Database.open(database) as read:
    found = {}
    for image in read.read_all_images():
        camera = read.read_camera(image.camera_id)
        points = read.read_keypoints(image.image_id)[:, :2].tolist()
        found[image.name] = [[camera.height, camera.width], points]
print(json.dumps(found))
"""


def colmap(images: Path, masks: Path | None, root: Path) -> dict[str, list[list[float]]]:
    """Size and features of each image as COLMAP sees it; in a process of its own, it is native code."""
    if find_spec("pycolmap") is None:
        pytest.skip("pycolmap is not installed")
    database = root / f"{masks is None}.db"
    names = sorted(p.name for p in images.iterdir())
    words = json.dumps([str(images), str(masks or ""), str(database), names])
    done = subprocess.run(
        [sys.executable, "-c", COLMAP, words], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, list[list[float]]] = json.loads(done.stdout.splitlines()[-1])
    return found


def photographs(folder: Path, turn: int, ending: str = ".JPG") -> np.ndarray:
    """Frames that are stored as a camera held that way stores them; the truth as displayed."""
    images, truth = draw_clip(3, FRAMES, *SIZE)
    folder.mkdir(parents=True)
    exif = Image.Exif()
    exif[ORIENTATION] = turn
    for t, image in enumerate(images):
        stored = np.dstack([as_stored(image[..., c], turn) for c in (2, 1, 0)])
        Image.fromarray(stored).save(folder / f"IMG_{t:04d}{ending}", exif=exif, quality=95)
    return truth


def moved(source: Path, truth: np.ndarray, root: Path, **settings: str) -> Path:
    """A store with the truth as what moves."""
    masks = root / "given"
    masks.mkdir()
    names = (
        [p.stem for p in sorted(source.iterdir())] if source.is_dir() else [f"{t:05d}" for t in range(FRAMES)]
    )
    for name, mask in zip(names, truth, strict=True):
        (masks / f"{name}.png").write_bytes(encode_png(mask.astype(np.uint16)))
    chosen = {"proposals.path": str(masks), "groups.count": "2", "frames.width": SIZE[1]}
    segment(source, root, chosen | {name.replace("_", "."): value for name, value in settings.items()})
    return root / "store"


def export(store: Path, out: Path, name: str, *words: str) -> int:
    return main(["export", name, "--store", str(store), "-o", str(out), "--format", *words])


def ignored(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        assert image.mode == "L"
        return np.asarray(image) == 0


@pytest.mark.parametrize("turn", range(1, 9))
def test_a_turned_array_is_stored_as_pillow_turns_it_back(turn: int) -> None:
    stored = np.arange(12, dtype=np.uint8).reshape(3, 4)
    inverse = {6: 8, 8: 6}.get(turn, turn)
    assert np.array_equal(as_stored(as_stored(stored, inverse), turn), stored)


@pytest.mark.parametrize(
    ("turn", "ending"), [(1, ".jpg"), (3, ".png"), (6, ".JPG"), (7, ".tif"), (8, ".jpeg")]
)
def test_masks_lie_on_the_stored_pixels_under_the_name_of_the_image(
    turn: int, ending: str, tmp_path: Path
) -> None:
    truth = photographs(tmp_path / "photos", turn, ending)
    store = moved(tmp_path / "photos", truth, tmp_path)
    assert export(store, tmp_path / "colmap", "photos", "colmap") == 0
    assert export(store, tmp_path / "nerf", "photos", "nerfstudio") == 0
    for t in range(FRAMES):
        with Image.open(tmp_path / "photos" / f"IMG_{t:04d}{ending}") as image:
            stored = as_stored(truth[t], turn)
            if ending != ".tif":  # which Pillow turns
                assert image.size == stored.shape[::-1]
        for mask in (f"colmap/photos/IMG_{t:04d}{ending}.png", f"nerf/photos/masks/IMG_{t:04d}.png"):
            assert np.array_equal(ignored(tmp_path / mask), stored)
    assert len(list((tmp_path / "colmap" / "photos").iterdir())) == FRAMES


@pytest.mark.parametrize("turn", [1, 6])
def test_colmap_finds_no_feature_where_something_moves(turn: int, tmp_path: Path) -> None:
    truth = photographs(tmp_path / "photos", turn)
    store = moved(tmp_path / "photos", truth, tmp_path)
    assert export(store, tmp_path / "masks", "photos", "colmap", "--dilate", "2") == 0
    found = [colmap(tmp_path / "photos", m, tmp_path) for m in (None, tmp_path / "masks" / "photos")]
    seen = [0, 0]
    for t in range(FRAMES):
        stored = as_stored(truth[t], turn)
        for k, features in enumerate(found):
            size, points = features[f"IMG_{t:04d}.JPG"]
            assert tuple(size) == stored.shape
            assert points
            x, y = np.floor(np.array(points)).astype(int).T
            seen[k] += int(stored[y, x].sum())
    assert seen[0]
    assert not seen[1]


@pytest.mark.parametrize("ending", [".png", ".jpg"])
@pytest.mark.parametrize("cut", [False, True])
def test_masks_of_a_video_are_called_like_the_frames_that_were_extracted(
    ending: str, cut: bool, tmp_path: Path
) -> None:
    """FFmpeg counts from 1, and writes all frames, used or not."""
    images, truth = draw_clip(3, FRAMES, *SIZE)
    write_mp4(tmp_path / "walk.mp4", images)
    store = moved(tmp_path / "walk.mp4", truth, tmp_path, **({"video_start": "1f"} if cut else {}))
    frames = tmp_path / "frames"
    frames.mkdir()
    for t, image in enumerate(images, 1):
        cv2.imwrite(str(frames / f"frame_{t:04d}{ending}"), image)
    assert export(store, tmp_path / "exported", "walk", "colmap", "--images", str(frames)) == 0
    used = range(cut, FRAMES)
    assert {p.name for p in (tmp_path / "exported" / "walk").iterdir()} == {
        f"frame_{t + 1:04d}{ending}.png" for t in used
    }
    for t in used:
        found = ignored(tmp_path / "exported" / "walk" / f"frame_{t + 1:04d}{ending}.png")
        assert (found & truth[t]).sum() > 0.9 * (found | truth[t]).sum()
    assert export(store, tmp_path / "plain", "walk", "colmap") == 0
    assert {p.name for p in (tmp_path / "plain" / "walk").iterdir()} == {f"{t:05d}.png.png" for t in used}


def test_images_that_are_not_those_of_the_video_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, truth = draw_clip(3, FRAMES, *SIZE)
    write_mp4(tmp_path / "walk.mp4", images)
    store = moved(tmp_path / "walk.mp4", truth, tmp_path)
    frames = tmp_path / "frames"
    frames.mkdir()
    for words in ("holds 0 images, walk has 4 frames", "holds 1 images", "holds 2 images", "holds 3 images"):
        assert export(store, tmp_path / "exported", "walk", "colmap", "--images", str(frames)) == 2
        assert words in capsys.readouterr().err
        cv2.imwrite(str(frames / f"{len(list(frames.iterdir()))}.png"), images[0, :48])
    assert export(store, tmp_path / "exported", "walk", "colmap", "--images", str(frames)) == 2
    assert "0.png: is 128 x 48, the frames are 128 x 96" in capsys.readouterr().err
    assert export(store, tmp_path / "exported", "walk", "davis", "--images", str(frames)) == 2
    assert "--images does nothing for davis" in capsys.readouterr().err
    assert not (tmp_path / "exported").exists()


def test_photographs_that_are_gone_or_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = photographs(tmp_path / "photos", 6)
    store = moved(tmp_path / "photos", truth, tmp_path)
    (tmp_path / "photos").rename(tmp_path / "moved")
    assert export(store, tmp_path / "exported", "photos", "colmap") == 2
    assert "its images are gone or others" in capsys.readouterr().err
    assert export(store, tmp_path / "exported", "photos", "colmap", "--images", str(tmp_path / "moved")) == 0
    assert np.array_equal(
        ignored(tmp_path / "exported" / "photos" / "IMG_0002.JPG.png"), as_stored(truth[2], 6)
    )
