"""An artifact that is one file: any reader opens it, no byte of it can be harmed unnoticed, a run mends it."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from conftest import draw_clip, write_folder
from escapes_help import Sandbox
from runs import data_bytes, masks, segment
from stores_help import (
    HARMS,
    Everything,
    Harm,
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
    truncate,
    write_part,
)
from zarr.storage import ZipStore

from zsmoseg.errors import StoreError
from zsmoseg.stores import archive, files
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.checks import check, joined_problem, part_problem
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.stores.fields import fields_of
from zsmoseg.stores.inside import Folder
from zsmoseg.stores.location import Store
from zsmoseg.stores.reader import read_video
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.upkeep import garbage, remove_garbage, take_back, verify

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
    packed = make_archive(store, note="x" * (archive._SMALL + archive._TAIL))
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
    for name in ("image", "forward", "label"):
        yield name, partial(read_video, artifact, name, 0, FRAMES - (name == "forward"))
    for name in ("state", "residual", "area"):
        yield name, partial(_table, artifact, name)
    for name in ("image", "label", "state", "residual", "area", "name", "time"):
        yield name, partial(_opened, artifact, name)


def _table(artifact: Artifact, name: str) -> Any:
    return getattr(Everything.read(artifact, 0, FRAMES), name)


def _opened(artifact: Artifact, name: str) -> Any:
    return open_dataset(artifact)[name].values


def reads_right_or_not(artifact: Artifact, truth: list[Any]) -> None:
    """Every reading gives the truth or an error; what a reading takes back is put there again."""
    damaged = artifact.archive.read_bytes() if artifact.packed else None
    for (name, read), values in zip(readings(artifact), truth, strict=True):
        if damaged is not None and not artifact.packed:
            artifact.archive.write_bytes(damaged)
        try:
            found = read()
        except (StoreError, ValueError, RuntimeError, zipfile.BadZipFile):
            continue
        np.testing.assert_array_equal(found, values, err_msg=f"{name}: read as good")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Artifact, bytes, list[Any]]:
    """An archive, its bytes, and all that is read of it."""
    artifact = make_archive(make_store(tmp_path_factory.mktemp("sound")))
    return artifact, artifact.archive.read_bytes(), [read() for _, read in readings(artifact)]


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


@pytest.mark.parametrize("tail", [None, 20_000, 200])
def test_a_byte_that_changed_anywhere_is_never_read_as_good(
    tail: int | None, sound: tuple[Artifact, bytes, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """``tail``: as a large file, of which so much is read at once."""
    artifact, whole, truth = sound
    if tail is not None:
        monkeypatch.setattr(archive, "_SMALL", 0)
        monkeypatch.setattr(archive, "_TAIL", tail)
    end = len(whole) - 2000  # the directory of the zip, whose names others go by
    for place in [*range(0, end, 20 * STEP), *range(end, len(whole), STEP)]:
        rewrite(artifact.archive, whole)
        flip(artifact.archive, place)
        reads_right_or_not(artifact, truth)
    rewrite(artifact.archive, whole)


def test_the_directory_that_other_readers_go_by_is_checked_too(
    sound: tuple[Artifact, bytes, list[Any]],
) -> None:
    """A name that changed there would be a chunk that is missing: fill value, without an error."""
    artifact, whole, _ = sound
    assert part_problem(artifact, 0) is None
    for place in range(len(whole) - 1000, len(whole), 3):
        rewrite(artifact.archive, whole)
        flip(artifact.archive, place)
        assert part_problem(artifact, 0) == "its record is damaged", place
        with pytest.raises(StoreError, match="run the same command again"):
            open_dataset(artifact)
    rewrite(artifact.archive, whole)


@pytest.mark.parametrize("length", [0, 1, 20, 0.3, 0.6, 0.9, -1])
def test_one_that_was_cut_off_counts_for_nothing(
    length: float, sound: tuple[Artifact, bytes, list[Any]]
) -> None:
    artifact, whole, truth = sound
    rewrite(artifact.archive, whole[: int(length * len(whole)) if 0 < length < 1 else int(length)])
    assert part_problem(artifact, 0) == "its record is damaged"
    assert joined_problem(artifact) == "not finished yet"
    assert [damage.path for damage in check(artifact)] == [artifact.archive]
    reads_right_or_not(artifact, truth)
    rewrite(artifact.archive, whole + b"more")
    assert [damage.path for damage in check(artifact)] == [artifact.archive]
    rewrite(artifact.archive, whole)
    assert check(artifact, deep=True) == []


def test_one_that_is_gone_is_not_computed_yet(store: Store) -> None:
    artifact = make_archive(store)
    delete(artifact.archive)
    assert part_problem(artifact, 0) == "not computed yet"
    assert not artifact.exists
    assert list(store.artifacts()) == []
    with pytest.raises(StoreError, match="nothing here"):
        open_dataset(artifact)


@pytest.mark.parametrize("other", ["another key", "another stage", "another video"])
def test_one_of_another_place_does_not_count(other: str, store: Store) -> None:
    one, two = make_archive(store), make_archive(store, "k1", seed=1)
    place = {"another key": two.archive, "another stage": one.archive.parents[1] / "depth/k0.zip",
             "another video": store.path / "sheep-fedcba9876543210/flow/k0.zip"}[other]  # fmt: skip
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(one.archive, place)
    artifact = Artifact(place.with_suffix(""))
    assert part_problem(artifact, 0) == "its record is damaged"
    assert [damage.path for damage in check(artifact)] == [place]
    with pytest.raises(StoreError):
        read_video(artifact, "label", 0, FRAMES)
    assert check(one, deep=True) == []


def test_of_what_is_damaged_nothing_stays_when_it_is_read(store: Store) -> None:
    artifact = make_archive(store)
    found = archive.recall(artifact.archive)
    assert found is not None
    begin, size, _ = found.members[artifact.shard("label", 0)]
    flip(artifact.archive, begin + size // 2)
    assert part_problem(artifact, 0) is None, "its size is as it was"
    with pytest.raises(
        StoreError, match=r"label/c\.0\.0\.0: has other content than was written; run the same"
    ):
        read_video(artifact, "label", 0, FRAMES)
    assert part_problem(artifact, 0) == "not computed yet"
    assert not artifact.archive.exists()
    again = make_archive(store)
    np.testing.assert_array_equal(read_video(again, "label", 0, FRAMES), content(FRAMES)["label"])


@pytest.mark.parametrize("harm", HARMS)
def test_repair_takes_it_away_and_what_is_sound_stays(harm: Harm, store: Store) -> None:
    one, two = make_archive(store, "k1"), make_archive(store, "k2")
    before = two.archive.read_bytes()
    harm(one.archive)
    found = take_back(store)
    assert [damage.path for damage in found] == [one.archive] * (harm is not delete)
    assert not one.archive.exists()
    assert two.archive.read_bytes() == before
    assert verify(store) == []


# ---------------------------------------------------------------------- runs of a tiny video
@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("tiny")
    write_folder(root / "disc", draw_clip(0, 3, 96, 128)[0])
    segment(root / "disc", root / "run", {"overlay.write": False})
    return root


def archives(root: Path) -> list[Path]:
    return sorted((root / "store").rglob("*.zip"))


def again(finished: Path, root: Path, **settings: Any) -> set[str]:
    """The stages that the next run computes."""
    report, counter = segment(finished / "disc", root, {"overlay.write": False, **settings})
    assert not report.failures
    return counter.stages


@pytest.fixture
def tiny(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished / "run", tmp_path / "run")
    return tmp_path / "run"


def test_a_tiny_video_leaves_one_file_a_stage(finished: Path, tiny: Path) -> None:
    found = archives(tiny)
    assert len(found) >= 8
    folders = {path.parent.name for path in found}
    assert len(folders) == len(found)
    left = {p.relative_to(tiny / "store").parts[1] for p in (tiny / "store").glob("*-*/*/*")}
    assert left == folders | {"probes", "runs"}
    assert again(finished, tiny) == set()
    assert verify(Store.open(tiny / "store", create=False)) == []


@pytest.mark.parametrize("harm", [delete, empty, truncate, flip])
def test_a_run_mends_any_archive(harm: Harm, finished: Path, tiny: Path) -> None:
    before, picture = data_bytes(tiny / "store"), masks(tiny / "out" / "disc")
    for path in archives(tiny):
        if harm is flip:
            flip(
                path, path.stat().st_size - 100
            )  # in the directory: a run looks at no more than record and sizes
        else:
            harm(path)
        assert path.parent.name in again(finished, tiny), path
        assert data_bytes(tiny / "store") == before, path
    np.testing.assert_array_equal(masks(tiny / "out" / "disc"), picture)
    assert verify(Store.open(tiny / "store", create=False)) == []


def test_repair_and_a_run_mend_a_byte_anywhere(finished: Path, tiny: Path) -> None:
    before, store = data_bytes(tiny / "store"), Store.open(tiny / "store", create=False)
    for number, path in enumerate(archives(tiny)):
        flip(path, path.stat().st_size * (number % 5) // 5)
        assert [damage.path for damage in take_back(store)] == [path]
        assert again(finished, tiny) >= {path.parent.name}
        assert data_bytes(tiny / "store") == before
        assert verify(store) == []


def test_another_length_of_chunks_keeps_what_is_there(finished: Path, tiny: Path, tmp_path: Path) -> None:
    assert again(finished, tiny, **{"chunk.length": 2}) == set()
    cut = tmp_path / "cut"
    again(finished, cut, **{"chunk.length": 2})
    assert again(finished, cut) == set()
    assert len(archives(cut)) < len(archives(tiny))


def test_what_a_killed_run_left_beside_an_archive_is_swept(finished: Path, tiny: Path) -> None:
    (path, *_) = archives(tiny)
    gone = {"host": socket.gethostname(), "pid": 2**22 + 1, "started": 0.0, "id": "x"}
    leases = [Artifact(path.with_suffix("")).lease_path(work) for work in ("0000", "begin")]
    for lease in leases:
        Path(lease).write_text(json.dumps(gone))
    assert [a.archive for a in Store(tiny / "store").artifacts() if a.packed] == archives(tiny), "none is one"
    assert again(finished, tiny) == set()
    assert not list((tiny / "store").rglob("*.lease"))
    Path(leases[0]).write_text(json.dumps(gone))
    delete(path)
    assert path.parent.name in again(finished, tiny), "who is gone holds nothing up"
    assert not list((tiny / "store").rglob("*.lease"))


def test_gc_takes_archives_and_probes_that_no_run_reaches(finished: Path, tiny: Path) -> None:
    first = archives(tiny)
    again(finished, tiny, **{"video.end": "2f"})
    store = Store.open(tiny / "store", create=False)
    assert garbage(store).paths == []
    (run,) = {p.stem for p in store.runs.glob("*.json")} - {
        p.stem for p in (finished / "run/store/runs").iterdir()
    }
    (old,) = {p.stem for p in store.runs.glob("*.json")} - {run}
    found = garbage(store, [old])
    (frames,) = [p for p in first if p.parent.name == "frames"]
    probe = frames.parents[1] / "probes" / f"{frames.stem}.json"
    assert set(found.paths) >= {*first, probe}
    assert set(found.paths) - {probe} <= set(first)
    remove_garbage(store, found, [old])
    assert not any(p.exists() for p in (*first, probe))
    assert len(store.video(store.videos()[0]).probes()) == 1
    assert verify(store) == []
    assert again(finished, tiny, **{"video.end": "2f"}) == set()


def test_a_run_that_cuts_the_video_otherwise_takes_what_another_wrote_meanwhile(store: Store) -> None:
    artifact = make_artifact(store, sealed=False)
    artifact.invalidate([1])
    make_archive(store)
    assert [part_problem(artifact, part) for part in range(3)] == [None] * 3
    assert joined_problem(artifact) is None
    np.testing.assert_array_equal(read_video(artifact, "label", 4, 8), content(FRAMES)["label"][4:8])
    truncate(artifact.archive)
    assert part_problem(artifact, 1) == "its record is damaged"
    write_part(artifact, 1, content(FRAMES))
    assert not artifact.packed
    assert [part_problem(artifact, part) for part in range(3)] == [None] * 3
    seal_it(artifact)
    assert verify(store) == []


# ---------------------------------------------------------------------- links
def test_a_link_in_the_place_of_an_archive_is_not_followed(
    finished: Path, tiny: Path, tmp_path: Path
) -> None:
    sandbox = Sandbox(tmp_path, [tiny / "store", tiny / "out", finished / "disc"])
    before, store = data_bytes(tiny / "store"), Store.open(tiny / "store", create=False)
    for path in archives(tiny):
        target = tmp_path / "outside" / path.name
        path.rename(target)
        path.symlink_to(target)
        artifact = Artifact(path.with_suffix(""))
        with sandbox.untouched():
            assert not artifact.exists
            assert part_problem(artifact, 0) == "not computed yet"
            assert path not in [found.archive for found in store.artifacts()]
            assert path not in garbage(store).paths
            take_back(store)
            again(finished, tiny)
        assert target.is_file()
        assert not path.is_symlink()
    assert data_bytes(tiny / "store") == before


# ---------------------------------------------------------------------- the last record of a folder
@pytest.mark.parametrize("harm", HARMS)
def test_without_its_last_record_no_part_counts_and_all_is_mended(harm: Harm, store: Store) -> None:
    artifact, whole = make_artifact(store), content(FRAMES)
    healthy = {p: p.read_bytes() for p in artifact.path.rglob("*") if p.is_file()}
    harm(record_path(artifact, "done"))
    assert artifact.done is None
    assert [part_problem(artifact, part) for part in range(3)] == ["not computed yet"] * 3
    with pytest.raises(StoreError, match="run the same command again"):
        read_video(artifact, "label", 0, 4)
    with pytest.raises(StoreError, match="run the same command again"):
        open_dataset(artifact)
    assert [d.path for d in check(artifact)] == [record_path(artifact, "done")] * (harm is not delete)
    take_back(store)
    for part in range(3):
        write_part(artifact, part, whole)
    seal_it(artifact)
    assert {p: p.read_bytes() for p in artifact.path.rglob("*") if p.is_file()} == healthy


def test_a_last_record_that_lacks_a_part_does_not_vouch_for_it(store: Store) -> None:
    artifact = make_artifact(store)
    done = read_record(record_path(artifact, "done"))
    assert done is not None
    assert set(done["parts"]) == {"0000", "0001", "0002"}
    write_record(record_path(artifact, "done"), {**done, "parts": {"0000": done["parts"]["0000"]}})
    assert [part_problem(artifact, i) for i in range(3)] == [None, "not computed yet", "not computed yet"]
    with pytest.raises(StoreError, match="not computed yet"):
        open_dataset(artifact)
    for part in (1, 2):
        write_part(artifact, part, content(FRAMES))
    seal_it(artifact)
    assert check(artifact, deep=True) == []
    assert artifact.done == done


class Crash(BaseException):
    """The process is gone."""


def crash_at(step: int, patch: pytest.MonkeyPatch) -> None:
    """After ``step`` changes of the disk."""
    left = [step]
    for name in ("write", "write_whole", "remove"):
        change = getattr(files, name)

        def counted(*given: Any, change: Callable[..., None] = change) -> None:
            if not left[0]:
                raise Crash
            left[0] -= 1
            change(*given)

        patch.setattr(files, name, counted)


def crashes(work: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """``work``, killed after no change of the disk, after one, and so on until it ends."""
    for step in range(200):
        with monkeypatch.context() as patch:
            crash_at(step, patch)
            try:
                work()
                return
            except Crash:
                pass
        yield step
    raise AssertionError("no end")


def test_a_crash_at_any_step_of_sealing_loses_no_part(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    artifact = make_artifact(store)
    done, steps = artifact.done, 0
    for steps in crashes(lambda: seal_it(artifact), monkeypatch):  # noqa: B007
        assert [part_problem(artifact, part) for part in range(3)] == [None] * 3
        assert artifact.done in (None, done)
        np.testing.assert_array_equal(read_video(artifact, "label", 0, FRAMES), content(FRAMES)["label"])
        if artifact.done:
            assert check(artifact, deep=True) == []
    assert steps > 40
    assert artifact.done == done
    assert sorted(p.name for p in Folder(artifact.path).record_place("x").parent.iterdir()) == [
        *(f"{part:04d}.tables" for part in range(3)), "artifact.json", "done.json",
    ]  # fmt: skip


def test_a_crash_between_the_last_record_and_the_removal_of_others_leaves_it_sealed(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact = make_artifact(store, sealed=False)
    drop = Folder.drop

    def die(folder: Folder, name: str) -> None:
        if name != "done":
            raise Crash
        drop(folder, name)

    with monkeypatch.context() as patch:
        patch.setattr(Folder, "drop", die)
        with pytest.raises(Crash):
            seal_it(artifact)
    assert all(record_path(artifact, name).exists() for name in (0, 1, 2, "done"))
    assert check(artifact, deep=True) == []
    assert joined_problem(artifact) is None
    other = content(FRAMES, seed=7)
    write_part(artifact, 1, other)
    assert artifact.done is None, "what it says of part 1 is past"
    seal_it(artifact)
    assert check(artifact, deep=True) == []
    np.testing.assert_array_equal(open_dataset(artifact)["label"][4:8], other["label"][4:8])


def test_a_crash_at_any_step_of_taking_back_keeps_the_other_parts(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact, seen = make_artifact(store), set()
    for _ in crashes(lambda: artifact.invalidate([1]), monkeypatch):
        assert [part_problem(artifact, part) for part in (0, 2)] == [None, None]
        assert part_problem(artifact, 1) in (None, "not computed yet")
        assert not (artifact.done and part_problem(artifact, 1))
        seen.add((artifact.done is None, part_problem(artifact, 1)))
        if artifact.done is None:
            write_part(artifact, 1, content(FRAMES))
            seal_it(artifact)
    assert {done for done, _ in seen} == {True, False}
    assert part_problem(artifact, 1) == "not computed yet"


def test_an_archive_appears_whole_or_not_at_all(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in crashes(lambda: make_archive(store), monkeypatch):
        assert not any(p.is_file() for p in store.path.rglob("flow/*"))
    assert check(make_archive(store), deep=True) == []


def test_many_parts_are_one_record(store: Store) -> None:
    artifact = make_artifact(store, frames=60, length=1)
    assert len(list(record_path(artifact, "done").parent.glob("*.json"))) == 2
    assert [part_problem(artifact, part) for part in range(60)] == [None] * 60
    np.testing.assert_array_equal(read_video(artifact, "label", 0, 60), content(60)["label"])
    artifact.invalidate([30])
    assert [part for part in range(60) if part_problem(artifact, part)] == [30]
    write_part(artifact, 30, content(60))
    seal_it(artifact)
    assert check(artifact, deep=True) == []
