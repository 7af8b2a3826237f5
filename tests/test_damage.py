"""Every single file of a finished store, deleted, emptied, truncated: the next run mends it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import masks, segment

from zsmoseg.stores.location import Store
from zsmoseg.stores.upkeep import take_back, verify


def delete(path: Path) -> None:
    path.unlink()


def empty(path: Path) -> None:
    path.write_bytes(b"")


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


SMALL = {"chunk.length": 3, "video.end": "6f", "overlay.write": False}
HARMS = [delete, empty, truncate]
EVERY = os.environ.get("ZSMOSEG_TEST_EVERY_HARM") == "1"
"""Each file gets each harm (minutes); otherwise each file gets one of the three."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("damage")
    write_folder(folder / "disc", draw_clip(0, 6, 96, 128)[0])
    segment(folder / "disc", folder / "run", SMALL)
    return folder / "run"


@pytest.mark.parametrize("number", range(3))
def test_the_next_run_mends_any_file_of_the_store(number: int, finished: Path, tmp_path: Path) -> None:
    expected = masks(finished / "out" / "disc")
    assert expected.any()
    files = [p.relative_to(finished) for p in sorted((finished / "store").rglob("*")) if p.is_file()]
    assert len(files) > 100
    root = tmp_path / "run"
    shutil.copytree(finished, root)
    redone = {}
    for place, name in enumerate(files):
        if not EVERY and place % 3 != number:
            continue
        harm = HARMS[number if EVERY else place // 3 % 3]
        harm(root / name)
        _, counter = segment(finished.parent / "disc", root, SMALL)
        redone[name] = counter.stages
        assert (root / name).exists() or "runs" in name.parts, f"{name} was not mended"
        np.testing.assert_array_equal(masks(root / "out" / "disc"), expected, err_msg=str(name))
    store = Store.open(root / "store", create=False)
    videos = {artifact.path / array for artifact in store.artifacts() for array in artifact.arrays}
    shards = {name for name in redone if name.name.startswith("c.") and root / name.parent in videos}
    flows = [redone[name] for name in shards if name.parent.name == "forward"]
    assert all({"flow", "features", "masks"} <= stages and "frames" not in stages for stages in flows)
    records = [stages for name, stages in redone.items() if name.suffix == ".tables" or name in shards]
    assert all("masks" in stages or "overlay" in stages for stages in records), (
        "what stages read is done again"
    )
    joined = [redone[name] for name in redone.keys() - shards if name.name.startswith("c.")]
    assert not any(joined), "what is joined for readers is made again without computing"


def test_verify_misses_what_a_run_had_finished_until_it_is_taken_back(finished: Path, tmp_path: Path) -> None:
    root = tmp_path / "run"
    shutil.copytree(finished, root)
    store = Store.open(root / "store", create=False)
    assert verify(store) == []
    for artifact in store.artifacts():
        path = artifact.path.with_name(f"{artifact.path.name}.zip")
        delete(path) if artifact.packed else shutil.rmtree(artifact.path)
        found = verify(store)
        assert [damage.path for damage in found] == [artifact.path]
        assert found == verify(store)
        take_back(store)
        assert verify(store) == []
        segment(finished.parent / "disc", root, SMALL)
        assert verify(store) == []
        if not artifact.packed:
            done = artifact.path / "records" / "done.json"
            delete(done)
            assert done in {damage.path for damage in verify(store)}
            segment(finished.parent / "disc", root, SMALL)
            assert verify(store) == []


@pytest.mark.parametrize("harm", [delete, empty, truncate])
def test_the_next_run_mends_any_file_of_the_output(
    harm: Callable[[Path], None], finished: Path, tmp_path: Path
) -> None:
    root = tmp_path / "run"
    shutil.copytree(finished, root)
    before = {p: p.read_bytes() for p in (root / "out" / "disc").rglob("*.png")}
    for path in sorted((root / "out" / "disc").rglob("*")):
        if path.is_file():
            harm(path)
            segment(finished.parent / "disc", root, SMALL)
            assert path.stat().st_size > 0
    assert {p: p.read_bytes() for p in (root / "out" / "disc").rglob("*.png")} == before
