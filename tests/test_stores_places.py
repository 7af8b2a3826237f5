"""Records vouch for what lies where they lie: exchanged with others of their kind they count for nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import draw_clip, write_folder
from runs import Counter, data_bytes, segment

from zsmoseg.stores.artifact import Artifact, part_name
from zsmoseg.stores.checks import part_problem
from zsmoseg.stores.imports import Brought, brought_before, remember
from zsmoseg.stores.location import Store
from zsmoseg.stores.upkeep import verify
from zsmoseg.workflows.running.request import Report

LONG, SHORT = 8, 3
"""Frames of a video whose artifacts are folders, and of one whose artifacts are one file each."""


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two long videos and two short ones, with two settings of the grouping."""
    root = tmp_path_factory.mktemp("places")
    for seed, (name, frames) in enumerate({"ant": LONG, "bee": LONG, "cat": SHORT, "dog": SHORT}.items()):
        write_folder(root / "clips" / name, draw_clip(5 * seed, frames)[0])
    for settings in ({"groups.share": 0.1}, {}):
        run_all(root, settings)
    return root


def run_all(root: Path, settings: dict[str, Any] | None = None) -> tuple[Report, Counter]:
    return segment(sorted((root / "clips").iterdir()), root, settings)


def artifacts(root: Path, video: str, stage: str) -> list[Artifact]:
    """Of a stage, the one that was used last first."""
    store = Store.open(root / "store", create=False)
    (found,) = [v for v in store.videos() if v.startswith(video)]
    return store.artifact(found, stage, "any").siblings()


def folder(root: Path, video: str, stage: str) -> Path:
    """The artifact of a stage that was used last."""
    return artifacts(root, video, stage)[0].path


def archive(root: Path, video: str, stage: str) -> Path:
    """The same of a short video."""
    found = artifacts(root, video, stage)[0]
    assert found.packed
    return found.archive


def swap(one: Path, two: Path) -> None:
    aside = one.with_name("aside")
    one.rename(aside)
    two.rename(one)
    aside.rename(two)


def other_key(root: Path) -> tuple[Path, Path]:
    one, two = artifacts(root, "ant", "groups")
    return one.path, two.path


def other_archive(root: Path) -> tuple[Path, Path]:
    one, two = artifacts(root, "cat", "groups")
    return one.archive, two.archive


def records(root: Path, *places: tuple[str, str, str]) -> tuple[Path, ...]:
    """By video, stage and name."""
    return tuple(folder(root, video, stage) / f"records/{name}.json" for video, stage, name in places)


def alone(root: Path, one: tuple[str, str, int], two: tuple[str, str, int]) -> tuple[Path, ...]:
    """Records of parts, of artifacts that are not sealed."""
    for video, stage, _ in (one, two):
        artifacts(root, video, stage)[0].unseal()
    return records(root, *((video, stage, part_name(part)) for video, stage, part in (one, two)))


def probes(root: Path) -> tuple[Path, ...]:
    return tuple(
        folder(root, video, "frames").parents[1] / f"probes/{folder(root, video, 'frames').name}.json"
        for video in ("ant", "bee")
    )


PAIRS: dict[str, Callable[[Path], tuple[Path, ...]]] = {
    "artifacts of two keys": other_key,
    "artifacts of two videos": lambda r: (folder(r, "ant", "flow"), folder(r, "bee", "flow")),
    "artifacts of two stages": lambda r: (folder(r, "ant", "frames"), folder(r, "ant", "flow")),
    "archives of two keys": other_archive,
    "archives of two videos": lambda r: (archive(r, "cat", "flow"), archive(r, "dog", "flow")),
    "archives of two stages": lambda r: (archive(r, "cat", "frames"), archive(r, "cat", "flow")),
    "records of two parts": lambda r: alone(r, ("ant", "flow", 0), ("ant", "flow", 1)),
    "records of two videos": lambda r: alone(r, ("ant", "labels", 1), ("bee", "labels", 1)),
    "last records of two videos": lambda r: records(r, ("ant", "flow", "done"), ("bee", "flow", "done")),
    "descriptions of two keys": lambda r: tuple(p / "records/artifact.json" for p in other_key(r)),
    "video.json": lambda r: tuple(folder(r, v, "flow").parents[1] / "video.json" for v in ("ant", "bee")),
    "probes": probes,
}
MENDED = ("video.json", "probes")
"""What is written again without computing."""


@pytest.mark.parametrize("what", PAIRS)
def test_what_is_exchanged_is_computed_again_and_equal(what: str, done: Path, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(done, root)
    before = data_bytes(root / "store")
    one, two = PAIRS[what](root)
    swap(one, two)
    assert verify(Store.open(root / "store", create=False)), "what lies in another place was believed"
    report, counter = run_all(root)
    assert not report.failures
    assert bool(counter.stages) == (what not in MENDED)
    run_all(root, {"groups.share": 0.1})
    after = data_bytes(root / "store")
    assert {path: after[path] for path in before} == before


def test_a_store_may_be_moved_and_a_video_renamed(done: Path, tmp_path: Path) -> None:
    shutil.copytree(done, tmp_path / "moved")
    store = Store.open(tmp_path / "moved/store", create=False)
    for artifact in store.artifacts():
        assert not any(part_problem(artifact, i) for i in range(len(artifact.parts)))
    (ant,) = [v for v in store.videos() if v.startswith("ant")]
    (store.path / ant).rename(store.path / f"emmet-{ant.split('-')[1]}")
    (cat,) = [v for v in store.videos() if v.startswith("cat")]
    (store.path / cat).rename(store.path / f"kitten-{cat.split('-')[1]}")
    report, counter = run_all(tmp_path / "moved")
    assert not report.failures
    assert not counter.stages


def test_what_was_imported_for_one_video_is_not_anothers(done: Path, tmp_path: Path) -> None:
    from zsmoseg.errors import StoreError

    shutil.copytree(done, tmp_path / "copy")
    store = Store.open(tmp_path / "copy/store", create=False)
    ant, bee = sorted(store.videos())[:2]
    remember(store, ant, {"depth": Brought("/depth", "f", "depth")})
    (store.path / ant / "imports.json").rename(store.path / bee / "imports.json")
    with pytest.raises(StoreError, match="damaged"):
        brought_before(store, bee)
