"""Every single file of a finished store, deleted, emptied, truncated: the next run mends it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from runs import masks, segment


def delete(path: Path) -> None:
    path.unlink()


def empty(path: Path) -> None:
    path.write_bytes(b"")


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.fixture(scope="module")
def finished(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("damage") / "run"
    segment(clip, root, {"chunk.length": 5, "video.end": "10f"})
    return root


@pytest.mark.parametrize("harm", [delete, empty, truncate])
def test_the_next_run_mends_any_file_of_the_store(
    harm: Callable[[Path], None], clip: Path, finished: Path, tmp_path: Path
) -> None:
    expected = masks(finished / "out" / "disc")
    files = [p.relative_to(finished) for p in sorted((finished / "store").rglob("*")) if p.is_file()]
    assert len(files) > 100
    root = tmp_path / "run"
    shutil.copytree(finished, root)
    redone = {}
    for name in files:
        harm(root / name)
        _, counter = segment(clip, root, {"chunk.length": 5, "video.end": "10f"})
        redone[name] = counter.stages
        assert (root / name).exists() or "runs" in name.parts, f"{name} was not mended"
        np.testing.assert_array_equal(masks(root / "out" / "disc"), expected, err_msg=str(name))
    harmed = [stages for name, stages in redone.items() if "c" in name.parts and "flow" in name.parts]
    assert harmed
    assert all({"flow", "tables", "masks"} <= stages for stages in harmed)
    assert not any("frames" in stages for stages in harmed)


@pytest.mark.parametrize("harm", [delete, empty, truncate])
def test_the_next_run_mends_any_file_of_the_output(
    harm: Callable[[Path], None], clip: Path, finished: Path, tmp_path: Path
) -> None:
    root = tmp_path / "run"
    shutil.copytree(finished, root)
    before = {p: p.read_bytes() for p in (root / "out" / "disc").rglob("*.png")}
    for path in sorted((root / "out" / "disc").rglob("*")):
        if path.is_file():
            harm(path)
            segment(clip, root, {"chunk.length": 5, "video.end": "10f"})
            assert path.stat().st_size > 0
    assert {p: p.read_bytes() for p in (root / "out" / "disc").rglob("*.png")} == before
