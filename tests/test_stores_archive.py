"""An artifact that is one file: any reader opens it, no byte of it can be harmed unnoticed, a run mends it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
import pytest
import xarray as xr
import zarr
from conftest import draw_clip, write_folder
from escapes_help import Sandbox
from runs import data_bytes, masks, segment
from stores_help import (
    Everything,
    block_of,
    content,
    delete,
    empty,
    flip,
    lay_out,
    make_archive,
    make_artifact,
    make_store,
    put_blocks,
    record_path,
    rewrite,
    seal_it,
    specs,
    truncate,
    write_part,
)
from zarr.storage import ZipStore

from zsmoseg.errors import StoreError
from zsmoseg.stores import archive, files, shards
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.checks import check, joined_problem, part_problem
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.fields import Codec, fields_of
from zsmoseg.stores.inside import Folder
from zsmoseg.stores.location import Store
from zsmoseg.stores.reader import read_video
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.stores.upkeep import garbage, remove_garbage, take_back, verify

Harm = Callable[[Path], None]
HARMS = [delete, empty, truncate, flip]
FRAMES = 10
STEP = 41
"""Of the bytes that are flipped, one in so many."""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return make_store(tmp_path)


def shots(artifact: Artifact, whole: dict[str, np.ndarray]) -> Iterator[Arrays]:
    """The video arrays at once, the tables of three shots one after another: none of the pair over a cut."""
    yield Everything(start=0, stop=FRAMES, **whole)
    for number, (start, stop) in enumerate([(0, 3), (3, 4), (4, FRAMES)]):
        pairs = np.arange(start, stop - 1, dtype=np.int32)
        yield Everything(
            start=start,
            stop=stop,
            state=pairs,
            scalar=np.float64(number),
            object=np.array([0, number + 1]),
            residual=np.arange(4.0).reshape(2, 2) + pairs[:, None, None],
            area=np.array([10, number]),
        )


def one_block(artifact: Artifact, whole: dict[str, np.ndarray]) -> Iterable[Arrays]:
    return [block_of(artifact, 0, whole)]


def make_folder(store: Store, left: Callable[..., Iterable[Arrays]], key: str = "folder") -> Artifact:
    """An artifact of one part in a folder."""
    artifact = store.artifact(store.videos()[0] if store.videos() else "goat-0123456789abcdef", "flow", key)
    lay_out(artifact, FRAMES, FRAMES)
    put_blocks(artifact, 0, *left(artifact, content(FRAMES)))
    seal_it(artifact)
    return artifact


# ---------------------------------------------------------------------- readers
@pytest.mark.parametrize("left", [one_block, shots])
def test_one_file_is_what_a_folder_of_the_same_content_is(
    left: Callable[..., Iterable[Arrays]], store: Store
) -> None:
    folder, packed = make_folder(store, left), make_archive(store, left=left)
    assert packed.packed
    assert not packed.path.exists()
    assert [p.name for p in packed.archive.parent.iterdir() if p.stem == "k0"] == ["k0.zip"]
    found = xr.open_zarr(ZipStore(packed.archive, read_only=True))
    assert set(found.variables) > set(fields_of(Everything)) - {"nothing", "flags"}
    xr.testing.assert_identical(found.load(), xr.open_zarr(folder.path).load())
    xr.testing.assert_identical(open_dataset(packed).load(), found)
    for name in found.variables:
        assert found[name].dtype == open_dataset(folder)[name].dtype


def test_zarr_reads_every_array_and_every_member_is_one_of_zarr(store: Store) -> None:
    packed, whole = make_archive(store), content(FRAMES)
    group = zarr.open_group(ZipStore(packed.archive, read_only=True), mode="r")
    for name in ("image", "label"):
        array = group[name]
        assert isinstance(array, zarr.Array)
        np.testing.assert_array_equal(array[:], whole[name])
    with zipfile.ZipFile(packed.archive) as opened:
        assert opened.testzip() is None
        assert {info.compress_type for info in opened.infolist()} == {zipfile.ZIP_STORED}
        names = opened.namelist()
    assert len(names) == len(set(names))
    assert [n for n in names if n.startswith("records/")] == ["records/0000.tables", archive.RECORD]
    listed = {n.removesuffix("/zarr.json") for n in names if n.endswith("/zarr.json")}
    assert listed == {name for name, _ in group.arrays()}


def test_what_was_left_is_read_back_block_by_block(store: Store) -> None:
    packed, folder = make_archive(store, left=shots, seconds=1.5), make_folder(store, shots)
    one, two = (list(Everything.read(artifact).blocks()) for artifact in (packed, folder))
    assert [(b.start, b.stop) for b in one] == [(0, 3), (3, 4), (4, FRAMES)]
    for block, other in zip(one, two, strict=True):
        for name in ("state", "scalar", "object", "residual", "area"):
            np.testing.assert_array_equal(getattr(block, name), getattr(other, name))
    whole = Everything.read(packed)
    assert whole.area.tolist() == [30, 0, 1, 2]
    for name, values in content(FRAMES).items():
        np.testing.assert_array_equal(getattr(whole, name), values)
    np.testing.assert_array_equal(Everything.read(packed, 3, 6).label, content(FRAMES)["label"][3:6])
    record = packed.part(0)
    assert record is not None
    assert record.seconds == 1.5


def test_the_same_content_gives_the_same_bytes(tmp_path: Path) -> None:
    one, two = (make_archive(make_store(tmp_path / name), left=shots, seconds=2).archive for name in "ab")
    assert one.read_bytes() == two.read_bytes()
    other = make_archive(make_store(tmp_path / "c"), left=shots, seconds=2, seed=1).archive
    assert other.read_bytes() != one.read_bytes()


def test_a_record_that_is_longer_than_what_is_read_at_once_is_read_whole(store: Store) -> None:
    packed = make_archive(store, note="x" * (2 * archive._TAIL))
    assert check(packed, deep=True) == []
    assert part_problem(packed, 0) is None
    np.testing.assert_array_equal(read_video(packed, "label", 0, FRAMES), content(FRAMES)["label"])
    flip(packed.archive, packed.archive.stat().st_size - archive._TAIL - 100)
    assert part_problem(packed, 0) == "its record is damaged"


def test_a_look_at_one_file_imports_no_zarr(store: Store) -> None:
    packed = make_archive(store)
    script = f"""
import sys
from pathlib import Path
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.reader import read_video
artifact = Artifact(Path({str(packed.path)!r}))
assert artifact.done and read_video(artifact, "forward", 0, 9).shape == (9, 2, 6, 7)
assert not {{"zarr", "xarray"}} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_it_is_written_once_and_for_all(store: Store) -> None:
    found = archive.recall(make_archive(store).archive)
    assert found is not None
    for change in (
        lambda: found.write("a", b""),
        lambda: found.growing("a"),
        lambda: found.put("a", {}),
        lambda: found.remove("label"),
        lambda: found.drop("done"),
    ):
        with pytest.raises(RuntimeError, match="once and for all"):
            change()


# ---------------------------------------------------------------------- harm
def readings(artifact: Artifact) -> Iterator[tuple[str, Callable[[], Any]]]:
    """All ways to read it."""
    yield from ((name, lambda name=name: read_video(artifact, name, 0, artifact.shape(name)[0]))
                for name in ("image", "forward", "label"))  # fmt: skip
    yield from ((name, lambda name=name: getattr(Everything.read(artifact, 0, FRAMES), name))
                for name in ("state", "residual", "area"))  # fmt: skip
    yield from ((name, lambda name=name: open_dataset(artifact)[name].values)
                for name in ("image", "label", "state", "residual", "area", "name", "time"))  # fmt: skip


def expected(artifact: Artifact) -> list[Any]:
    return [read() for _, read in readings(artifact)]


def reads_right_or_not(artifact: Artifact, truth: list[Any]) -> None:
    """Every reading gives the truth or an error; what a reading takes back is put there again."""
    damaged = artifact.archive.read_bytes() if artifact.packed else None
    for (name, read), values in zip(readings(artifact), truth, strict=True):
        if damaged is not None and not artifact.packed:
            artifact.archive.write_bytes(damaged)
        try:
            found = read()
        except (StoreError, ValueError, KeyError, RuntimeError, OSError, zipfile.BadZipFile):
            continue
        np.testing.assert_array_equal(found, values, err_msg=f"{name}: read as good")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Artifact, bytes, list[Any]]:
    """An archive, its bytes, and all that is read of it."""
    artifact = make_archive(make_store(tmp_path_factory.mktemp("sound")))
    return artifact, artifact.archive.read_bytes(), expected(artifact)


def test_a_byte_that_changed_anywhere_is_found_and_named(sound: tuple[Artifact, bytes, list[Any]]) -> None:
    artifact, whole, _ = sound
    store = Store(artifact.path.parents[2])
    for place in range(0, len(whole), STEP // 4):
        rewrite(artifact.archive, whole)
        flip(artifact.archive, place)
        assert [damage.path for damage in check(artifact, deep=True)] == [artifact.archive], place
    assert [damage.path for damage in verify(store)] == [artifact.archive]
    rewrite(artifact.archive, whole)
    assert verify(store) == []


def test_a_byte_that_changed_anywhere_is_never_read_as_good(sound: tuple[Artifact, bytes, list[Any]]) -> None:
    artifact, whole, truth = sound
    end = len(whole) - 2000  # the directory of the zip, whose names others go by
    for place in [*range(0, end, 20 * STEP), *range(end, len(whole), STEP)]:
        rewrite(artifact.archive, whole)
        flip(artifact.archive, place)
        reads_right_or_not(artifact, truth)
    rewrite(artifact.archive, whole)
