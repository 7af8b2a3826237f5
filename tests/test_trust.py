"""What changes between the plan and the reading is never stored under the key of what was planned."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, masks, segment

from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.request import Quiet, Report, Request
from zsmoseg.workflows.running.run import run

FRAMES = 8


class Meddler(Quiet):
    """Changes something when the plan is made and nothing is read yet."""

    def __init__(self, change: Callable[[], None]) -> None:
        self.change = change

    def planned(self, plan: VideoPlan) -> None:
        self.change()


def meddled(source: Path, root: Path, change: Callable[[], None], settings: dict[str, Any]) -> Report:
    chosen = resolve(overrides={"chunk.length": 4, **settings})
    return run(Request([str(source)], root / "out", root / "store", chosen, "serial"), Meddler(change))


def same_size_and_times(path: Path, content: bytes) -> None:
    """Other bytes under the old size and the old time of change, as some tools leave them."""
    seen = path.stat()
    path.write_bytes(content[: seen.st_size].ljust(seen.st_size, b"\0"))
    os.utime(path, ns=(seen.st_atime_ns, seen.st_mtime_ns))


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "disc", draw_clip(0, FRAMES)[0])


@pytest.mark.parametrize("how", ["other frame", "same size and times"])
def test_a_frame_that_changes_after_the_plan_fails_its_video_and_the_next_run_is_right(
    clip: Path, tmp_path: Path, how: str
) -> None:
    other = write_folder(tmp_path / "other", draw_clip(5, FRAMES)[0])
    files = sorted(clip.iterdir()), sorted(other.iterdir())
    image = files[1][6].read_bytes()

    def change() -> None:
        if how == "other frame":
            shutil.copy(files[1][6], files[0][6])
        else:
            files[0][6].write_bytes(image.ljust(files[0][6].stat().st_size, b"\0"))
            same_size_and_times(files[0][6], image)

    report = meddled(clip, tmp_path, change, {})
    assert "disc: changed since the run was planned" in report.failures["disc"]
    segment(clip, tmp_path)
    segment(clip, tmp_path / "fresh")
    np.testing.assert_array_equal(masks(tmp_path / "out/disc"), masks(tmp_path / "fresh/out/disc"))


def test_a_video_file_that_is_replaced_after_the_plan(tmp_path: Path) -> None:
    for seed, name in ((0, "a.mp4"), (5, "b.mp4")):
        writer = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter.fourcc(*"mp4v"), 25, (160, 120))
        for image in draw_clip(seed, FRAMES)[0]:
            writer.write(image)
        writer.release()
    report = meddled(
        tmp_path / "a.mp4", tmp_path, lambda: shutil.copy(tmp_path / "b.mp4", tmp_path / "a.mp4") and None, {}
    )
    assert "a.mp4: changed since the run was planned" in report.failures["a"]


def test_a_source_that_is_touched_only_goes_on(clip: Path, tmp_path: Path) -> None:
    report = meddled(clip, tmp_path, lambda: [os.utime(path) for path in clip.iterdir()] and None, {})
    assert not report.failures


def test_masks_and_the_ignore_mask_that_change_after_the_plan(clip: Path, tmp_path: Path) -> None:
    given = tmp_path / "masks"
    given.mkdir()
    for t, disc in enumerate(draw_clip(0, FRAMES)[1]):
        (given / f"{t:05d}.png").write_bytes(encode_png(np.where(disc, 7, 0).astype(np.uint16)))
    ignore = tmp_path / "ignore.png"
    cv2.imwrite(str(ignore), np.eye(120, 160, dtype=np.uint8))
    empty = encode_png(np.full((120, 160), 7, np.uint16))
    changes: list[tuple[Callable[[], None], str]] = [
        (lambda: (given / "00005.png").write_bytes(empty) and None, f"{given}: changed"),
        (lambda: cv2.imwrite(str(ignore), np.ones((120, 160), np.uint8)) and None, f"{ignore}: changed"),
    ]
    settings = {"proposals.path": str(given), "ignore.mask": str(ignore)}
    for k, (change, words) in enumerate(changes):
        report = meddled(clip, tmp_path / str(k), change, settings)
        assert words in report.failures["disc"]


def test_what_was_finished_before_the_change_is_what_its_key_says(clip: Path, tmp_path: Path) -> None:
    """The first chunk is decoded before a frame of the second one changes; under the old content all is as ever."""
    kept = tmp_path / "kept"
    shutil.copytree(clip, kept)
    files = sorted(clip.iterdir())
    meddled(clip, tmp_path, lambda: shutil.copy(files[0], files[7]) and None, {})
    shutil.copy(sorted(kept.iterdir())[7], files[7])
    segment(clip, tmp_path)
    segment(clip, tmp_path / "fresh")
    old, fresh = (data_bytes(root / "store") for root in (tmp_path, tmp_path / "fresh"))
    assert old == fresh
