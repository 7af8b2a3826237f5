"""Real video: what the default must reach on a sequence of DAVIS, and shots glued together."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from conftest import write_folder
from runs import masks, segment

from zsmoseg.metrics.regions import region_j
from zsmoseg.metrics.tracks import track_scores

QUICK = {"overlay.write": False, "chunk.length": 16}


def read(folder: Path, count: int | None = None, flag: int = cv2.IMREAD_COLOR) -> np.ndarray:
    return np.stack([cv2.imread(str(p), flag) for p in sorted(folder.iterdir())[:count]])


def test_the_car_is_found_and_nothing_else(davis: Path, tmp_path: Path) -> None:
    segment(davis / "JPEGImages/480p/car-shadow", tmp_path, QUICK)
    found = masks(tmp_path / "out" / "car-shadow") > 0
    truth = read(davis / "Annotations/480p/car-shadow", flag=cv2.IMREAD_GRAYSCALE) > 0
    assert np.mean([region_j(t, f) for t, f in zip(truth[1:-1], found[1:-1], strict=True)]) > 0.78
    assert track_scores(zip(truth.astype(int), found.astype(int), strict=True)).fu > 88


def test_two_real_shots_glued_together_give_the_masks_of_each_alone(davis: Path, tmp_path: Path) -> None:
    frames = {name: read(davis / "JPEGImages/480p" / name, 14) for name in ("dog", "blackswan")}
    alone = []
    for name, images in frames.items():
        segment(write_folder(tmp_path / name, images), tmp_path / f"run-{name}", QUICK)
        alone.append(masks(tmp_path / f"run-{name}" / "out" / name) > 0)
    segment(write_folder(tmp_path / "both", np.concatenate(list(frames.values()))), tmp_path / "run", QUICK)
    assert all(part.any() for part in alone)
    np.testing.assert_array_equal(masks(tmp_path / "run" / "out" / "both") > 0, np.concatenate(alone))


def test_a_photograph_that_is_panned_is_static(davis: Path, tmp_path: Path) -> None:
    photograph = cv2.imread(str(sorted((davis / "JPEGImages/480p/scooter-black").iterdir())[0]))
    height, width = photograph.shape[:2]
    noise = np.random.default_rng(0)
    images = []
    for t in range(8):
        matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 0.0, 1.25)
        matrix[:, 2] += (3.0 * (t - 4), 1.0 * (t - 4))
        moved = cv2.warpAffine(photograph, matrix, (width, height), flags=cv2.INTER_CUBIC)
        images.append(np.clip(moved + noise.normal(0, 3, moved.shape), 0, 255).astype(np.uint8))
    report, _ = segment(write_folder(tmp_path / "pan", np.stack(images)), tmp_path, QUICK)
    assert report.summaries["pan"]["moving_pixels_percent"] < 0.5
