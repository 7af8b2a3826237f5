"""Records vouch for what lies where they lie: exchanged with others of their kind they count for nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, segment

from zsmoseg.stores.checks import part_problem
from zsmoseg.stores.location import Store
from zsmoseg.workflows.imports.record import Brought, brought_before, remember


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two videos, with two settings of the grouping."""
    root = tmp_path_factory.mktemp("places")
    for seed, name in ((0, "ant"), (5, "bee")):
        write_folder(root / "clips" / name, draw_clip(seed, 8)[0])
    for settings in ({"groups.share": 0.1}, {}):
        segment([root / "clips/ant", root / "clips/bee"], root, settings)
    return root


def folder(root: Path, video: str, stage: str) -> Path:
    """The artifact of a stage that was used last."""
    store = Store.open(root / "store", create=False)
    (found,) = [v for v in store.videos() if v.startswith(video)]
    return max(
        (root / "store" / found / stage).iterdir(),
        key=lambda p: (p / "records/artifact.json").stat().st_mtime,
    )


def swap(one: Path, two: Path) -> None:
    aside = one.with_name("aside")
    one.rename(aside)
    two.rename(one)
    aside.rename(two)


def other_key(root: Path) -> tuple[Path, Path]:
    groups = folder(root, "ant", "groups")
    (other,) = [p for p in groups.parent.iterdir() if p != groups]
    return groups, other


PAIRS: dict[str, Callable[[Path], tuple[Path, Path]]] = {
    "artifacts of two keys": other_key,
    "artifacts of two videos": lambda r: (folder(r, "ant", "flow"), folder(r, "bee", "flow")),
    "artifacts of two stages": lambda r: (folder(r, "ant", "frames"), folder(r, "ant", "flow")),
    "records of two parts": lambda r: (
        folder(r, "ant", "flow") / "records/0000.json",
        folder(r, "ant", "flow") / "records/0001.json",
    ),
    "records of two videos": lambda r: (
        folder(r, "ant", "labels") / "records/0001.json",
        folder(r, "bee", "labels") / "records/0001.json",
    ),
    "descriptions of two keys": lambda r: (*(p / "records/artifact.json" for p in other_key(r)),),  # type: ignore[dict-item, return-value]
    "video.json": lambda r: (
        folder(r, "ant", "flow").parents[1] / "video.json",
        folder(r, "bee", "flow").parents[1] / "video.json",
    ),
}


@pytest.mark.parametrize("what", PAIRS)
def test_what_is_exchanged_is_computed_again_and_equal(what: str, done: Path, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(done, root)
    before = data_bytes(root / "store")
    swap(*PAIRS[what](root))
    report, counter = segment([root / "clips/ant", root / "clips/bee"], root)
    assert not report.failures
    if what != "video.json":
        assert counter.stages, "what lies in another place was believed"
    segment([root / "clips/ant", root / "clips/bee"], root, {"groups.share": 0.1})
    after = data_bytes(root / "store")
    assert {path: after[path] for path in before} == before


def test_a_store_may_be_moved_and_a_video_renamed(done: Path, tmp_path: Path) -> None:
    shutil.copytree(done, tmp_path / "moved")
    store = Store.open(tmp_path / "moved/store", create=False)
    for artifact in store.artifacts():
        assert not any(part_problem(artifact, i) for i in range(len(artifact.parts)))
    (ant,) = [v for v in store.videos() if v.startswith("ant")]
    (store.path / ant).rename(store.path / f"emmet-{ant.split('-')[1]}")
    _, counter = segment([tmp_path / "moved/clips/ant", tmp_path / "moved/clips/bee"], tmp_path / "moved")
    assert not counter.stages


def test_what_was_imported_for_one_video_is_not_anothers(done: Path, tmp_path: Path) -> None:
    from zsmoseg.errors import StoreError

    shutil.copytree(done, tmp_path / "copy")
    store = Store.open(tmp_path / "copy/store", create=False)
    ant, bee = sorted(store.videos())
    remember(store, ant, {"depth": Brought("/depth", "f", "depth")})
    (store.path / ant / "imports.json").rename(store.path / bee / "imports.json")
    with pytest.raises(StoreError, match="damaged"):
        brought_before(store, bee)
