"""Whatever happens to a file, no wrong value is read: it is noticed, named, and done again."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stores_help import (
    content,
    cut,
    data_files,
    delete,
    empty,
    flip,
    make_artifact,
    make_store,
    specs,
    truncate,
    write_part,
)

from zsmoseg.errors import SpaceError, StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.location import Store
from zsmoseg.stores.upkeep import take_back, verify

Harm = Callable[[Path], None]
HARMS = [delete, empty, truncate, flip]
SHARD = "data.zarr/label/c/1/0/0"
TABLE = "data.zarr/parts/0001/state/c.0"
RECORD = "parts/0001.json"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return make_store(tmp_path)


@pytest.mark.parametrize("harm", HARMS)
def test_no_file_of_an_artifact_can_be_harmed_unnoticed_and_all_can_be_mended(
    harm: Harm, store: Store
) -> None:
    artifact, whole = make_artifact(store), content(10)
    healthy = data_files(artifact)
    paths = [p for p in sorted(artifact.path.rglob("*")) if p.is_file()]
    assert len(paths) > 40
    for path in paths:
        harm(path)
        found = verify(store)
        if not (harm is delete and path.name == "done.json"):
            assert found, f"{path} {harm.__name__}: not noticed"
            lost = {path, artifact.path / "artifact.json"} & {damage.path for damage in found}
            assert lost, f"{path} {harm.__name__}: not named"
        take_back(store)
        artifact.begin({"stage": "flow", "key": "k0", "settings": {}}, cut(10, 4), specs(10))
        for part in range(len(artifact.parts)):
            if artifact.part_problem(part):
                write_part(artifact, part, whole)
        artifact.seal()
        assert verify(store) == []
        assert data_files(artifact) == healthy


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_shard_is_never_read_and_named_instead(harm: Harm, store: Store) -> None:
    artifact = make_artifact(store)
    harm(artifact.path / SHARD)
    with pytest.raises(StoreError, match=SHARD):
        artifact.read("label", 3, 8)
    np.testing.assert_array_equal(artifact.read("label", 0, 4), content(10)["label"][:4])


def read_or_error(artifact: Artifact, name: str, start: int, stop: int) -> np.ndarray | StoreError:
    try:
        return artifact.read(name, start, stop)
    except StoreError as error:
        return error


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), name=st.sampled_from(["frame", "forward", "label"]))
def test_a_flipped_bit_anywhere_in_a_shard_never_changes_a_value(
    place: float, name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    artifact = make_artifact(make_store(tmp_path_factory.mktemp("flip")))
    shard = artifact.shard(name, 1)
    flip(shard, int(place * shard.stat().st_size))
    found = read_or_error(artifact, name, 4, 8)
    if isinstance(found, StoreError):
        assert str(shard) in str(found)
        assert artifact.part_problem(1) == "not computed yet"
    else:
        np.testing.assert_array_equal(found, content(10)[name][4:8])


@pytest.mark.parametrize("harm", HARMS)
@pytest.mark.parametrize("name", [TABLE, "data.zarr/parts/0001/state/zarr.json", RECORD])
def test_a_damaged_table_is_never_read_and_the_next_run_redoes_it(
    name: str, harm: Harm, store: Store
) -> None:
    artifact = make_artifact(store)
    harm(artifact.path / name)
    with pytest.raises(StoreError, match=f"{name}.*run the same command again"):
        artifact.read_table(1)
    assert artifact.part_problem(1)
    assert artifact.read_table(0)["state"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("harm", [delete, empty, truncate])
@pytest.mark.parametrize("name", [SHARD, TABLE, RECORD])
def test_a_look_at_sizes_names_what_is_wrong_with_a_part(name: str, harm: Harm, store: Store) -> None:
    artifact = make_artifact(store)
    harm(artifact.path / name)
    problem = artifact.part_problem(1)
    assert problem is not None
    assert name in problem or name == RECORD
    assert [artifact.part_problem(part) for part in (0, 2)] == [None, None]
    assert [(damage.path, damage.part) for damage in artifact.check()] == [(artifact.path / name, 1)]


def test_a_shard_of_other_content_and_equal_size_is_found_by_content(store: Store) -> None:
    """The CRC-32C of a file that ends with its own says nothing: records use another checksum."""
    one, two = Artifact(store.path / "a"), Artifact(store.path / "b")
    for artifact, value in ((one, 1), (two, 2)):
        artifact.begin({}, [(0, 3)])
        artifact.write(0, tables={"t": np.full(3, value, np.uint8)})
    table = "data.zarr/parts/0000/t/c.0"
    (one.path / table).write_bytes((two.path / table).read_bytes())
    assert one.check() == []
    assert [damage.what for damage in one.check(deep=True)] == ["has other content than was written"]
    with pytest.raises(StoreError, match="other content"):
        one.read_table(0)


def test_damaged_metadata_of_an_array_are_an_error_until_mended(store: Store) -> None:
    artifact = make_artifact(store)
    empty(artifact.data / "label" / "zarr.json")
    with pytest.raises(StoreError, match=r"label/zarr.json: is missing or damaged"):
        artifact.read("label", 0, 3)
    artifact.begin({"stage": "flow", "key": "k0", "settings": {}}, cut(10, 4), specs(10))
    np.testing.assert_array_equal(artifact.read("label", 0, 10), content(10)["label"])


@pytest.mark.parametrize("harm", HARMS)
def test_a_shard_that_was_damaged_can_be_written_again(harm: Harm, store: Store) -> None:
    artifact = make_artifact(store)
    shard = artifact.shard("label", 2)
    healthy = shard.read_bytes()
    harm(shard)
    write_part(artifact, 2, content(10))
    assert shard.read_bytes() == healthy


def test_what_a_killed_writer_left_is_gone_when_the_part_is_written_again(store: Store) -> None:
    artifact = make_artifact(store)
    healthy = data_files(artifact)
    artifact.invalidate([1])
    shard = artifact.shard("frame", 1)
    shard.with_name("0.0123456789abcdef.partial").write_bytes(b"half")
    truncate(shard)
    (artifact.table_folder(1) / "half").mkdir()
    (artifact.table_folder(1) / "half" / "zarr.json").write_bytes(b"{")
    write_part(artifact, 1, content(10))
    assert data_files(artifact) == healthy


def test_a_record_of_other_frames_than_the_part_has_does_not_count(store: Store) -> None:
    artifact = make_artifact(store)
    artifact.record_path(0).write_bytes(artifact.record_path(1).read_bytes())
    assert artifact.part_problem(0) == "the video was cut in another way"
    with pytest.raises(StoreError, match="part 0: the video was cut in another way"):
        artifact.seal()


def test_invalidating_takes_back_that_all_is_done_before_the_parts(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact, removed = make_artifact(store), []
    monkeypatch.setattr(files, "remove", lambda path: removed.append(path.name))
    artifact.invalidate([0, 2])
    assert removed[0] == "done.json"
    assert {"0000.json", "0002.json"} <= set(removed)


class FullDisk:
    """Room for a number of files, then none; half of the file that does not fit is written."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, fits: int, where: str) -> None:
        self.left, self.where, self.write = fits, where, Path.write_bytes
        monkeypatch.setattr(Path, "write_bytes", lambda path, data: self._write(path, data))

    def _write(self, path: Path, data: bytes) -> int:
        if self.where not in str(path):
            return self.write(path, data)
        self.left -= 1
        if self.left < 0:
            self.write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.write(path, data)


@pytest.mark.parametrize("fits", range(9))
def test_a_full_disk_leaves_nothing_of_the_part_and_says_so_in_one_line(
    fits: int, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact = make_artifact(store)
    with monkeypatch.context() as patch:
        FullDisk(patch, fits, "parts/0001/")
        with pytest.raises(SpaceError) as caught:
            write_part(artifact, 1, content(10))
    assert str(artifact.path) in str(caught.value)
    assert "MB free" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert artifact.part_problem(1) == "not computed yet"
    assert not artifact.table_folder(1).exists()
    assert not any((artifact.data / name / "c" / "1").exists() for name in artifact.arrays)
    write_part(artifact, 1, content(10))
    artifact.seal()
    assert artifact.check(deep=True) == []


def _no_space(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_disk_that_is_full_when_a_shard_is_written_leaves_no_shard(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zarr.storage import LocalStore

    artifact = make_artifact(store)

    async def fail(*_: Any, **__: Any) -> None:
        _no_space()

    with monkeypatch.context() as patch:
        patch.setattr(LocalStore, "set", fail)
        with pytest.raises(SpaceError, match="no space left"):
            write_part(artifact, 1, content(10))
    assert not (artifact.data / "frame" / "c" / "1").exists()
    assert artifact.part(1) is None
    assert artifact.part_problem(0) is None


@pytest.mark.parametrize("step", ["record", "seal", "begin"])
def test_a_full_disk_is_said_in_words_wherever_it_strikes(
    step: str, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact = make_artifact(store)
    artifact.invalidate([1])
    if step == "seal":
        write_part(artifact, 1, content(10))
    steps: dict[str, Callable[[], object]] = {
        "record": lambda: write_part(artifact, 1, content(10)),
        "seal": artifact.seal,
        "begin": lambda: Artifact(store.path / "other").begin({}, [(0, 3)]),
    }
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", _no_space)
        with pytest.raises(SpaceError):
            steps[step]()
    assert artifact.done is None
    assert not list(store.path.rglob("*.tmp"))
