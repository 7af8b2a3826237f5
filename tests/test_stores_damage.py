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
    HARMS,
    Everything,
    Harm,
    begin_with,
    content,
    data_files,
    delete,
    empty,
    flip,
    lay_out,
    make_artifact,
    make_store,
    put_blocks,
    record_path,
    seal_it,
    shard_path,
    tables_path,
    truncate,
    write_part,
)

from zsmoseg.errors import SpaceError, StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.checks import check, joined_problem, part_problem
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.location import Store
from zsmoseg.stores.packing import sealed
from zsmoseg.stores.reader import read_video
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.upkeep import take_back, verify

SHARD = "label/c.1.0.0"
TABLE = "records/0001.tables"
RECORD = "records/0001.json"


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
            lost = {path, record_path(artifact, "artifact")} & {damage.path for damage in found}
            assert lost, f"{path} {harm.__name__}: not named"
        take_back(store)
        lay_out(artifact)
        for part in range(len(artifact.parts)):
            if part_problem(artifact, part):
                write_part(artifact, part, whole)
        if joined_problem(artifact):
            seal_it(artifact)
        assert verify(store) == []
        assert data_files(artifact) == healthy


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_shard_is_never_read_and_named_instead(harm: Harm, store: Store) -> None:
    artifact = make_artifact(store)
    harm(artifact.path / SHARD)
    with pytest.raises(StoreError, match=SHARD):
        read_video(artifact, "label", 3, 8)
    np.testing.assert_array_equal(read_video(artifact, "label", 0, 4), content(10)["label"][:4])


def test_no_file_that_only_zarr_would_believe_is_read(store: Store) -> None:
    """One of another artifact, of the same shape and length: its own checksum is right."""
    artifact = make_artifact(store)
    chunks = [name for name in (artifact.done or {})["files"] if not name.endswith("zarr.json")]
    assert len(chunks) > 10
    for name in chunks:
        path = artifact.path / name
        mine = path.read_bytes()
        path.write_bytes(sealed(bytes([*mine[:-5], mine[-5] ^ 1])))
        with pytest.raises(
            StoreError, match=f"^{artifact.path / name}: has other content than was written; zsmoseg repair"
        ):
            open_dataset(artifact).load()
        path.write_bytes(mine)
    path.write_bytes(b"other")
    take_back(store)
    seal_it(artifact)
    open_dataset(artifact).load()


def read_or_error(artifact: Artifact, name: str, start: int, stop: int) -> np.ndarray | StoreError:
    try:
        return read_video(artifact, name, start, stop)
    except StoreError as error:
        return error


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), name=st.sampled_from(["image", "forward", "label"]))
def test_a_flipped_bit_anywhere_in_a_shard_never_changes_a_value(
    place: float, name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    artifact = make_artifact(make_store(tmp_path_factory.mktemp("flip")))
    shard = shard_path(artifact, name, 1)
    flip(shard, int(place * shard.stat().st_size))
    found = read_or_error(artifact, name, 4, 8)
    if isinstance(found, StoreError):
        assert str(shard) in str(found)
        assert part_problem(artifact, 1) == "not computed yet"
    else:
        np.testing.assert_array_equal(found, content(10)[name][4:8])


@pytest.mark.parametrize("harm", HARMS)
@pytest.mark.parametrize("name", [TABLE, RECORD])
def test_a_damaged_table_is_never_read_and_the_next_run_redoes_it(
    name: str, harm: Harm, store: Store
) -> None:
    artifact = make_artifact(store, sealed=False)
    harm(artifact.path / name)
    where = name if name == TABLE else "part 1"
    with pytest.raises(StoreError, match=f"{where}.*run the same command again"):
        _ = Everything.read(artifact, 4, 8).state
    assert part_problem(artifact, 1)
    assert Everything.read(artifact, 0, 4).state.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("name", ["residual/c.0.0.0", "residual/zarr.json", "zarr.json", "name/c.0"])
@pytest.mark.parametrize("harm", [delete, empty, truncate])
def test_a_damaged_joined_table_is_named_and_made_again_from_the_parts(
    name: str, harm: Harm, store: Store
) -> None:
    artifact = make_artifact(store)
    healthy = data_files(artifact)
    harm(artifact.path / name)
    with pytest.raises(StoreError, match=f"{name}.*run the same command again"):
        open_dataset(artifact)
    assert all(part_problem(artifact, part) is None for part in range(3))
    seal_it(artifact)
    assert data_files(artifact) == healthy
    assert open_dataset(artifact)["residual"].shape == (9, 4, 4)


def test_a_flipped_bit_in_a_joined_table_is_never_read(store: Store) -> None:
    artifact = make_artifact(store)
    flip(artifact.path / "residual" / "c.0.0.0")
    with pytest.raises(StoreError, match=r"residual.c\.0\.0\.0: has other content"):
        _ = open_dataset(artifact)["residual"].values
    assert [damage.path for damage in verify(store)] == [artifact.path / "residual" / "c.0.0.0"]


@pytest.mark.parametrize("harm", [delete, empty, truncate])
@pytest.mark.parametrize("name", [SHARD, TABLE, RECORD])
def test_a_look_at_sizes_names_what_is_wrong_with_a_part(name: str, harm: Harm, store: Store) -> None:
    artifact = make_artifact(store, sealed=False)
    harm(artifact.path / name)
    problem = part_problem(artifact, 1)
    assert problem is not None
    assert name in problem or name == RECORD
    assert [part_problem(artifact, part) for part in (0, 2)] == [None, None]
    lost = harm is delete and name == RECORD  # as before it was computed
    assert [(found.path, found.part) for found in check(artifact)] == [(artifact.path / name, 1)] * (not lost)


def test_a_shard_of_other_content_and_equal_size_is_found_by_content(store: Store) -> None:
    """The CRC-32C of a file that ends with its own says nothing: records use another checksum."""
    one, two = Artifact(store.path / "a"), Artifact(store.path / "b")
    for artifact, value in ((one, 1), (two, 2)):
        begin_with(artifact, [(0, 3)])
        put_blocks(artifact, 0, Everything(start=0, stop=3, state=np.full(2, value, np.int32)))
    table = "records/0000.tables"
    (one.path / table).write_bytes((two.path / table).read_bytes())
    assert check(one) == []
    assert [damage.what for damage in check(one, deep=True)] == ["has other content than was written"]
    with pytest.raises(StoreError, match="other content"):
        _ = Everything.read(one).state


@pytest.mark.parametrize("harm", HARMS)
def test_damaged_metadata_of_an_array_change_no_value_and_are_named_and_mended(
    harm: Harm, store: Store
) -> None:
    artifact = make_artifact(store)
    harm(artifact.path / "label" / "zarr.json")
    np.testing.assert_array_equal(read_video(artifact, "label", 0, 10), content(10)["label"])
    assert {damage.path for damage in verify(store)} == {artifact.path / "label" / "zarr.json"}
    lay_out(artifact)
    assert verify(store) == []
    np.testing.assert_array_equal(open_dataset(artifact)["label"], content(10)["label"])


@pytest.mark.parametrize("harm", HARMS)
def test_a_shard_that_was_damaged_can_be_written_again(harm: Harm, store: Store) -> None:
    artifact = make_artifact(store)
    shard = shard_path(artifact, "label", 2)
    healthy = shard.read_bytes()
    harm(shard)
    write_part(artifact, 2, content(10))
    assert shard.read_bytes() == healthy


def test_what_a_killed_writer_left_is_gone_when_the_part_is_written_again(store: Store) -> None:
    artifact = make_artifact(store)
    healthy = data_files(artifact)
    artifact.invalidate([1])
    shard = shard_path(artifact, "image", 1)
    truncate(shard)
    tables_path(artifact, 1).write_bytes(b"half")
    write_part(artifact, 1, content(10))
    seal_it(artifact)
    assert data_files(artifact) == healthy


def test_a_record_of_other_frames_than_the_part_has_does_not_count(store: Store) -> None:
    artifact = make_artifact(store, sealed=False)
    record_path(artifact, 0).write_bytes(record_path(artifact, 1).read_bytes())
    assert part_problem(artifact, 0) == "its record is damaged", "it is that of another place"
    other = read_record(record_path(artifact, 1))
    assert other is not None
    write_record(record_path(artifact, 0), other)
    assert part_problem(artifact, 0) == "the video was cut in another way"
    with pytest.raises(StoreError, match="part 0: the video was cut in another way"):
        seal_it(artifact)


def test_invalidating_takes_back_that_all_is_done_before_the_parts(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact, removed = make_artifact(store), []
    monkeypatch.setattr(files, "remove", lambda path: removed.append(path.name))
    artifact.invalidate([0, 2])
    assert removed[0] == "done.json"
    assert {"0000.json", "0002.json"} <= set(removed)


class FullDisk:
    """Room for a number of tables, then none; half of the one that does not fit is written."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, fits: int) -> None:
        self.left, self.add = fits, files.Appended.add
        monkeypatch.setattr(files.Appended, "add", lambda file, content: self._add(file, content))

    def _add(self, file: files.Appended, content: bytes) -> int:
        self.left -= 1
        if self.left < 0:
            self.add(file, content[: len(content) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.add(file, content)


@pytest.mark.parametrize("fits", range(7))
def test_a_full_disk_leaves_nothing_of_the_part_and_says_so_in_one_line(
    fits: int, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact = make_artifact(store)
    with monkeypatch.context() as patch:
        FullDisk(patch, fits)
        with pytest.raises(SpaceError) as caught:
            write_part(artifact, 1, content(10))
    assert str(artifact.path) in str(caught.value)
    assert "MB free" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert part_problem(artifact, 1) == "not computed yet"
    assert not tables_path(artifact, 1).exists()
    assert not any(shard_path(artifact, name, 1).exists() for name in artifact.arrays)
    write_part(artifact, 1, content(10))
    seal_it(artifact)
    assert check(artifact, deep=True) == []


def _no_space(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("fits", range(3))
def test_a_disk_that_is_full_when_a_shard_is_written_leaves_no_shard(
    fits: int, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact, written = make_artifact(store), [0]
    write = files.write

    def fail(path: Path, data: bytes) -> None:
        written[0] += 1
        if written[0] > fits:
            write(path, data[: len(data) // 2])
            _no_space()
        write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(files, "write", fail)
        with pytest.raises(SpaceError, match="no space left"):
            write_part(artifact, 1, content(10))
    assert written[0] == fits + 1
    assert not any(shard_path(artifact, name, 1).exists() for name in artifact.arrays)
    assert artifact.part(1) is None
    assert part_problem(artifact, 0) is None


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
        "seal": lambda: seal_it(artifact),
        "begin": lambda: begin_with(Artifact(store.path / "other"), [(0, 3)]),
    }
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", _no_space)
        with pytest.raises(SpaceError):
            steps[step]()
    assert artifact.done is None
    assert not list(store.path.rglob("*.tmp"))
