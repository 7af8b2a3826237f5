"""What a store is, what it remembers, what may go; and that looking at it is cheap."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stores_help import (
    FINGERPRINT,
    HARMS,
    Harm,
    content,
    delete,
    empty,
    flip,
    lay_out,
    make_archive,
    make_artifact,
    make_store,
    record_path,
    truncate,
)

from zsmoseg.errors import SpaceError, StoreError, ZsmosegError, system_errors_in_words
from zsmoseg.stores import files
from zsmoseg.stores.keys import FORMAT, key
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import MARK, Store
from zsmoseg.stores.reader import read_video
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.runs import Entry, RunRecord, entry_paths, forget_run, list_runs, read_run, run_path
from zsmoseg.stores.upkeep import garbage, remove_garbage, take_back, verify


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return make_store(tmp_path)


# ---------------------------------------------------------------------- keys and records
values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
objects = st.dictionaries(st.text(max_size=4), values, max_size=4)


@given(objects, st.integers())
def test_the_key_does_not_depend_on_the_order_of_settings(settings: dict, seed: int) -> None:
    items = list(settings.items())
    Random(seed).shuffle(items)
    one, two = (key(1, "flow", 2, found, {"frames": "a"}, "f") for found in (settings, dict(items)))
    assert one == two
    assert len(one) == 20
    assert set(one) <= set("0123456789abcdef")


def test_the_key_changes_with_everything_that_values_depend_on() -> None:
    base = (1, "flow", 1, {"stride": 4}, {"frames": "a"}, "f")
    others = [2, "depth", 2, {"stride": 5}, {"frames": "b"}, "g"]
    keys = {key(*base)} | {key(*base[:i], other, *base[i + 1 :]) for i, other in enumerate(others)}
    assert len(keys) == 7


def test_a_setting_that_is_not_a_number_has_no_key() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        key(1, "flow", 1, {"stride": float("nan")}, {}, "f")


@given(objects)
def test_a_record_reads_as_it_was_written(value: dict) -> None:
    with TemporaryDirectory() as folder:
        write_record(Path(folder) / "a.json", value)
        assert read_record(Path(folder) / "a.json") == value


def test_no_flipped_bit_in_a_record_changes_what_is_read(tmp_path: Path) -> None:
    path, value = tmp_path / "a.json", {"files": {"a/b": {"size": 3}}, "seconds": 0.25, "ok": True}
    write_record(path, value)
    data = path.read_bytes()
    for place in range(len(data)):
        for bit in range(8):
            path.write_bytes(data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :])
            assert read_record(path) in (None, value)


def test_numbers_of_numpy_may_stand_in_records_but_not_nan(tmp_path: Path) -> None:
    write_record(
        tmp_path / "a.json", {"n": np.int32(3), "x": np.float32(0.5), "a": np.arange(2), "t": (1, 2)}
    )
    assert read_record(tmp_path / "a.json") == {"n": 3, "x": 0.5, "a": [0, 1], "t": [1, 2]}
    with pytest.raises(ValueError, match="JSON compliant"):
        write_record(tmp_path / "b.json", {"x": float("nan")})
    assert not (tmp_path / "b.json").exists()


# ---------------------------------------------------------------------- what is a store
def test_a_store_is_made_only_when_asked_for(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="there is no store"):
        Store.open(tmp_path / "new", create=False)
    assert not (tmp_path / "new").exists()
    Store.open(tmp_path / "new", create=True)
    assert Store.open(tmp_path / "new", create=False).videos() == []


def test_an_empty_folder_becomes_a_store(tmp_path: Path) -> None:
    Store.open(tmp_path, create=True)
    assert json.loads((tmp_path / "zsmoseg.json").read_text())["format"] == FORMAT


@pytest.mark.parametrize("create", [True, False])
def test_a_folder_of_other_things_is_refused_and_left_alone(create: bool, tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(StoreError, match="is not a store"):
        Store.open(tmp_path, create=create)
    with pytest.raises(StoreError, match="is not a store"):
        Store.open(tmp_path / "holiday.jpg", create=create)
    assert [p.name for p in tmp_path.iterdir()] == ["holiday.jpg"]


@pytest.mark.parametrize(
    ("version", "what"), [(FORMAT + 1, "a newer zsmoseg"), (FORMAT - 1, "an older zsmoseg")]
)
def test_a_store_of_another_format_is_refused_with_both_versions_and_what_to_do(
    version: int, what: str, store: Store
) -> None:
    (store.path / "zsmoseg.json").write_text(json.dumps({"format": version, "more": []}))
    words = (
        f"format {version}, this zsmoseg writes format {FORMAT}; use {what} for it, or give another folder"
    )
    with pytest.raises(StoreError, match=words):
        Store.open(store.path, create=True)
    assert json.loads((store.path / "zsmoseg.json").read_text())["format"] == version


@pytest.mark.parametrize("harm", [delete, empty, truncate])
def test_a_store_that_lost_its_mark_is_still_one_and_gets_it_back(harm: Harm, store: Store) -> None:
    harm(store.path / "zsmoseg.json")
    Store.open(store.path, create=False)
    assert [damage.path.name for damage in verify(store)] == ["zsmoseg.json"]
    Store.open(store.path, create=True)
    assert verify(store) == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(StoreError, match=r"new: cannot be written \(Permission denied\)"):
        Store.open(tmp_path / "new", create=True)


# ---------------------------------------------------------------------- videos
@pytest.mark.parametrize(
    ("name", "folder"),
    [("goat", "goat"), ("a/b c", "a_b_c"), ("..", "video"), ("Straße-1", "Straße-1"), ("x" * 300, "x" * 80)],
)
def test_a_video_has_a_folder_of_its_name_and_fingerprint(name: str, folder: str, store: Store) -> None:
    assert store.video_id(name, "f" * 64) == f"{folder}-{'f' * 16}"


def test_a_video_is_found_again_whatever_its_name_is_now(store: Store) -> None:
    assert store.videos() == ["goat-0123456789abcdef"]
    assert store.video_id("renamed", FINGERPRINT) == "goat-0123456789abcdef"


@pytest.mark.parametrize("harm", HARMS)
def test_what_is_known_of_a_video_is_written_again_when_damaged(harm: Harm, store: Store) -> None:
    video = store.video("goat-0123456789abcdef")
    harm(video.path / "video.json")
    assert video.description is None
    assert [damage.path.name for damage in verify(store)] == ["video.json"]
    store.describe_video(video.path.name, "goat.mp4", FINGERPRINT)
    assert video.description == {"source": "goat.mp4", "fingerprint": FINGERPRINT}


def test_a_video_that_was_moved_is_described_anew(store: Store) -> None:
    video = store.video("goat-0123456789abcdef")
    video.describe("moved.mp4", FINGERPRINT)
    assert video.description == {"source": "moved.mp4", "fingerprint": FINGERPRINT}
    assert verify(store) == []


@pytest.mark.parametrize("harm", HARMS)
def test_a_probe_is_never_read_damaged_and_is_written_again(harm: Harm, store: Store) -> None:
    video, probe = store.video("goat-0123456789abcdef"), {"names": ["a", "b"], "times": [0.0, 0.5]}
    video.keep_probe("k0", probe)
    video.keep_probe("k1", {"names": ["a"], "times": [0.0]})
    (path,) = [path for path in video.probes() if path.stem == "k0"]
    harm(path)
    assert video.probe("k0") is None
    assert [damage.path for damage in verify(store)] == [path] * (harm is not delete)
    video.keep_probe("k0", probe)
    assert video.probe("k0") == probe
    assert verify(store) == []


def test_a_probe_of_other_frames_does_not_count(store: Store) -> None:
    video = store.video("goat-0123456789abcdef")
    for frames, names in (("k0", ["a"]), ("k1", ["b"])):
        video.keep_probe(frames, {"names": names})
    one, two = video.probes()
    one.write_bytes(two.read_bytes())
    assert (video.probe("k0"), video.probe("k1")) == (None, {"names": ["b"]})
    assert [damage.path for damage in verify(store)] == [one]


@pytest.mark.parametrize("harm", [None, *HARMS])
def test_a_fingerprint_is_computed_once_unless_the_note_is_damaged(harm: Harm | None, store: Store) -> None:
    computed = []

    def compute() -> str:
        computed.append(1)
        return FINGERPRINT

    assert store.fingerprint_of("goat.mp4:3:5:7", compute) == FINGERPRINT
    if harm:
        (note,) = (store.path / "fingerprints").iterdir()
        harm(note)
    assert store.fingerprint_of("goat.mp4:3:5:7", compute) == FINGERPRINT
    assert len(computed) == (2 if harm else 1)
    store.fingerprint_of("goat.mp4:3:6:7", compute)
    assert len(computed) == (3 if harm else 2)


# ---------------------------------------------------------------------- runs and garbage
def remember(store: Store, *keys: str) -> str:
    record = RunRecord.begin(store, {"flow.stride": 4}, [f"goat{i}" for i in range(len(keys))])
    for i, k in enumerate(keys):
        record.note(Entry(record.id, f"goat{i}", "goat-0123456789abcdef", keys={"flow": k}, outcome="done"))
    record.end("done", {}, {})
    return record.id


def test_runs_are_listed_in_order_with_their_outcome(store: Store) -> None:
    ids = [remember(store, "k1"), remember(store, "k2")]
    assert [run["id"] for run in list_runs(store)] == ids
    run = read_run(store, ids[1])
    assert run is not None
    assert (run["outcome"], run["settings"], "numpy" in run["versions"]) == ("done", {"flow.stride": 4}, True)
    forget_run(store, ids[0])
    assert [run["id"] for run in list_runs(store)] == ids[1:]
    with pytest.raises(StoreError, match="no run nonsense"):
        forget_run(store, "nonsense")


def test_gc_keeps_what_any_run_reaches(store: Store) -> None:
    kept, lost, other = (make_artifact(store, name) for name in ("k1", "k2", "k3"))
    first, _ = remember(store, "k1"), remember(store, "k3")
    found = garbage(store)
    assert found.paths == [lost.path]
    assert found.size == sum(p.stat().st_size for p in lost.path.rglob("*") if p.is_file())
    assert lost.path.exists()
    remove_garbage(store, found)
    assert not lost.path.exists()
    assert garbage(store).paths == []
    remove_garbage(store, garbage(store, [first]), [first])
    assert not kept.path.exists()
    np.testing.assert_array_equal(read_video(other, "label", 0, 10), content(10)["label"])


def test_gc_takes_a_video_that_no_run_names_and_its_fingerprint(store: Store) -> None:
    make_artifact(store, "k1")
    run = remember(store, "k1")
    store.fingerprint_of("signature", lambda: FINGERPRINT)
    assert garbage(store).paths == []
    found = garbage(store, [run])
    assert [p.name for p in found.paths[:1]] == ["goat-0123456789abcdef"]
    remove_garbage(store, found, [run])
    assert store.videos() == []
    assert not any((store.path / "fingerprints").iterdir())
    assert list_runs(store) == []


@pytest.mark.parametrize("harm", [empty, truncate, flip])
def test_gc_removes_nothing_while_it_does_not_know_what_a_run_reaches(harm: Harm, store: Store) -> None:
    make_artifact(store, "k1")
    run = remember(store, "k1")
    (path,) = entry_paths(store)
    for record in (path, store.runs / f"{run}.json"):
        harm(record)
    with pytest.raises(StoreError, match=f"{path}: is damaged.*--forget {run}"):
        garbage(store)
    assert {damage.path.name for damage in verify(store)} == {f"{run}.json", path.name}
    assert len(garbage(store, [run]).paths) == 1
    take_back(store)
    assert verify(store) == [], "repair drops the record"
    assert len(garbage(store).paths) == 1


def test_gc_refuses_a_run_that_is_none(store: Store) -> None:
    with pytest.raises(StoreError, match="no run 7"):
        garbage(store, ["7"])


def leave(path: Path, age: float) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"half")
    os.utime(path, (time.time() - age,) * 2)
    return path


def unfinished(path: Path) -> Path:
    """What a killed writer of ``path`` leaves."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")


def test_leftovers_go_only_when_they_are_old(store: Store) -> None:
    artifact = make_artifact(store, "k1")
    remember(store, "k1")
    old = [
        leave(unfinished(store.runs / "a.json"), 4000),
        leave(unfinished(record_path(artifact, 1)), 4000),
        leave(unfinished(artifact.archive), 4000),
        leave(artifact.lease_path("seal"), 4000),
    ]
    leave(artifact.lease_path("0000"), 60)
    young = leave(unfinished(record_path(artifact, 1)), 60)
    assert sorted(garbage(store).paths) == sorted(old)
    Store.open(store.path, create=False)
    assert all(p.exists() for p in old)
    Store.open(store.path, create=True)
    assert [p.exists() for p in old] == [False, True, True, True]
    artifact.invalidate([1])
    lay_out(artifact)
    assert [p.exists() for p in (old[1], young)] == [False, True]
    remove_garbage(store, garbage(store))
    assert not any(p.exists() for p in old)
    assert young.exists()


def test_leftovers_in_an_artifact_that_goes_are_counted_once(store: Store) -> None:
    artifact = make_artifact(store, "k1")
    remember(store, "k2")
    leave(unfinished(artifact.path / "zarr.json"), 4000)
    assert garbage(store).paths == [artifact.path]


def test_the_size_of_what_is_not_there_is_none(tmp_path: Path) -> None:
    assert files.size(tmp_path / "nothing") is None
    assert files.folders(tmp_path / "nothing") == []


def test_a_full_disk_is_told_from_other_troubles(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="busy") as caught, files.errors_in_words(tmp_path):
        raise OSError(16, "busy")
    assert not isinstance(caught.value, SpaceError)


@pytest.mark.parametrize("number", [errno.EFBIG, errno.EIO, errno.EBUSY, errno.ENOSPC])
def test_what_the_system_says_of_no_file_names_the_one_that_is_written(number: int, tmp_path: Path) -> None:
    with (
        pytest.raises((ZsmosegError, OSError)) as caught,
        system_errors_in_words(),
        files.errors_in_words(tmp_path / "x"),
    ):
        raise OSError(number, os.strerror(number))
    assert isinstance(caught.value, ZsmosegError)
    assert str(caught.value).startswith(f"{tmp_path / 'x'}: ")
    assert "same command again" in str(caught.value)


DEEP = b'{"format": ' + b"[" * 200_000


def pipe(path: Path) -> None:
    os.mkfifo(path)


def listening(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the system takes short names of sockets only
    try:
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(path.name)
    finally:
        os.chdir(here)


STRANGE = [
    pipe,
    listening,
    Path.mkdir,
    lambda path: path.symlink_to("/dev/zero"),
    lambda path: path.write_bytes(DEEP),
]


@pytest.mark.parametrize("strange", STRANGE, ids=["pipe", "socket", "folder", "device", "deep"])
def test_what_is_no_file_or_no_record_in_the_place_of_one_is_told_at_once(
    strange: Callable[[Path], object], store: Store
) -> None:
    make_artifact(store, "k1")
    run = remember(store, "k1")
    video = store.video(store.videos()[0])
    video.keep_probe("f0", {"times": [0]})
    (entry,) = entry_paths(store)
    places = [run_path(store, run), entry, video.path / "video.json", *video.probes()]
    for path in places:
        path.unlink(missing_ok=True)
        strange(path)
    told = {damage.path for damage in verify(store)}
    assert told >= {path for path in places if path.name == "video.json" or not path.is_symlink()}
    take_back(store)
    left = [path for path in places[:2] if path.exists()]
    assert all(path.is_dir() or path.is_symlink() for path in left), "what is no folder goes"


@pytest.mark.parametrize("strange", STRANGE, ids=["pipe", "socket", "folder", "device", "deep"])
def test_a_mark_that_is_no_file_or_no_record_is_a_lost_one(
    strange: Callable[[Path], object], store: Store
) -> None:
    remember(store, "k1")
    (store.path / MARK).unlink()
    strange(store.path / MARK)
    assert store.path / MARK in {damage.path for damage in verify(Store.open(store.path, create=False))}


@pytest.mark.parametrize("strange", STRANGE, ids=["pipe", "socket", "folder", "device", "deep"])
def test_a_lease_that_is_no_file_is_that_of_nobody_known(
    strange: Callable[[Path], object], tmp_path: Path
) -> None:
    strange(tmp_path / "k1.seal.lease")
    with lease(tmp_path / "k1.seal.lease", wait=False) as held:
        assert not held or strange is STRANGE[3], "it was touched just now"


def test_a_damaged_probe_of_any_settings_is_taken_back(store: Store) -> None:
    remember(store, "k1")
    video = store.video(store.video_id("goat", FINGERPRINT))
    for harm in (empty, truncate, flip):
        for name in ("f0", "f1"):
            video.keep_probe(name, {"times": [0]})
        harm(video.path / "probes" / "f0.json")
        assert [damage.path for damage in take_back(store)] == [video.path / "probes" / "f0.json"]
        assert verify(store) == []
        assert [path.name for path in video.probes()] == ["f1.json"]


@pytest.mark.parametrize("which", ["run", "video", "probe", "description", "imports", "zip"])
def test_repair_leaves_what_cannot_be_read(which: str, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    make_archive(store, "k1")
    run = remember(store, "k1")
    video = store.video(store.videos()[0])
    video.keep_probe("f0", {"times": [0]})
    write_record(video.path / "imports.json", {})
    places = {
        "run": run_path(store, run),
        "video": next(entry_paths(store)),
        "probe": video.path / "probes" / "f0.json",
        "description": video.path / "video.json",
        "imports": video.path / "imports.json",
        "zip": video.artifact("flow", "k1").archive,
    }
    assert verify(store) == []
    closed, opened = places[which], os.open

    def refuse(path: Any, *rest: Any, **more: Any) -> int:
        if os.fspath(path) == str(closed):
            raise PermissionError(errno.EACCES, "Permission denied", str(closed))
        return opened(path, *rest, **more)

    monkeypatch.setattr(os, "open", refuse)
    os.utime(closed)  # what was read before is read again
    (damage,) = take_back(store)
    assert (damage.path, damage.what) == (closed, "cannot be read (Permission denied); mend that")
    if which == "video":
        with pytest.raises(StoreError, match="cannot be read"):
            garbage(store)
    monkeypatch.undo()
    os.utime(closed)
    assert verify(store) == []


def test_looking_at_records_imports_the_standard_library_only(store: Store) -> None:
    make_artifact(store, "k1")
    make_archive(store, "k2")
    remember(store, "k1", "k2")
    script = f"""
import sys
from zsmoseg.stores.checks import joined_problem, part_problem
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import MARK, Store
from zsmoseg.stores.runs import list_runs
from zsmoseg.stores.upkeep import garbage, verify
store = Store.open({str(store.path)!r}, create=True)
for artifact in store.artifacts():
    assert artifact.done and artifact.parts
    assert not any(part_problem(artifact, part) for part in range(len(artifact.parts)))
    assert not joined_problem(artifact)
assert len(list_runs(store)) == 1 and not garbage(store).paths
heavy = {{"numpy", "zarr", "xarray", "dask", "numcodecs", "google_crc32c"}}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
assert not verify(store) and not {{"zarr", "xarray", "dask"}} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_beginning_what_is_there_already_does_not_import_zarr(store: Store) -> None:
    artifact = make_artifact(store, "k1")
    script = f"""
import sys
from pathlib import Path
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.beginning import begin, plan_of
from zsmoseg.stores.reader import blocks, read_table, read_video
from zsmoseg.stores.schema import ArraySpec
artifact = Artifact(Path({str(artifact.path)!r}))
specs = [ArraySpec.from_json(fields) for fields in artifact.arrays.values()]
begin(artifact, plan_of({{"stage": "flow", "settings": {{"other": 1}}}}, artifact.parts, specs))
assert artifact.done and artifact.description["settings"] == {{"other": 1}}
assert read_table(artifact, blocks(artifact, 0, 4)[0], "scalar") == 0
assert read_video(artifact, "label", 0, 10).shape == (10, 6, 7)
assert "zarr" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True)
