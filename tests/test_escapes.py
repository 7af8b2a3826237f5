"""Names, links, lists and records that lead elsewhere: nothing is read, written or removed outside store and OUT."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from conftest import draw_clip, write_folder, write_mp4
from escapes_help import Sandbox, hostile
from runs import segment
from stores_help import record_path

from zsmoseg.errors import ModelError, ZsmosegError
from zsmoseg.formats import find_for_video, open_masks
from zsmoseg.settings import resolve
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.imports import brought_before
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import LIST, Output
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.upkeep import garbage, remove_garbage, take_back, verify
from zsmoseg.video.plain_names import stays
from zsmoseg.video.sources import title, unique_names
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.export.exporting import choose, export
from zsmoseg.workflows.models.unpacking import unpack
from zsmoseg.workflows.result import open_store
from zsmoseg.workflows.running.request import Report, Request
from zsmoseg.workflows.running.run import run

SMALL = {"chunk.length": 3}
COUNT = 40
FORMATS = ("davis", "colmap", "nerfstudio", "flo", "npy", "png", "coco", "netcdf", "zarr")
SLOW = ("coco", "netcdf", "zarr")
"""One file for all frames."""
STEMS = [
    "..", "...", "....", "..hidden", ".", ". .", " ", "-rf", "a\nb", "~", "$HOME", "%2e%2e", "..\\..\\canary", "con",
    "C:", "C:\\x", "\u202e", "😀", "é" * 120, "x" * 250, "zsmoseg.json", ".zsmoseg.json", ".zsmoseg", "store", "a.b.c",
    "..-..", ".../...", "*", "?", "[a]", "'", '"', ";rm", "|", "&", "\t", "\x7f", "a" * 130, "+", "_",
]  # fmt: skip
"""Of video files, without the ending."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``area``: a source, a store and an output folder."""
    area = tmp_path_factory.mktemp("escapes") / "area"
    write_folder(area / "disc", draw_clip(0, 4, 96, 128)[0])
    segment(area / "disc", area, SMALL)
    return area


@pytest.fixture
def area(finished: Path, tmp_path: Path) -> Path:
    """A copy, whose runs know the copy's folders."""
    copy = tmp_path / "area"
    shutil.copytree(finished, copy)
    segment(copy / "disc", copy, SMALL)
    for runs in [copy / "store" / "runs", *(copy / "store").glob("*/runs")]:
        for old in sorted(runs.iterdir())[:-1]:
            old.unlink()
    return copy


@pytest.fixture
def sandbox(area: Path, tmp_path: Path) -> Sandbox:
    return Sandbox(
        tmp_path, [area / name for name in ("disc", "store", "out", "exported", "brought", "sources")]
    )


def run_it(area: Path, **settings: Any) -> Report:
    """A run that may fail."""
    chosen = resolve(
        overrides={**SMALL, **{name.replace("_", "."): value for name, value in settings.items()}}
    )
    return run(Request([str(area / "disc")], area / "out", area / "store", chosen, "serial"))


def probe_record(area: Path) -> Path:
    return next((area / "store").glob("disc-*/probes/*.json"))


def run_record(area: Path) -> Path:
    return next((area / "store").glob("disc-*/runs/*.json"))


def commands(area: Path) -> None:
    """All that look at a store or clean it; what is wrong is one line and exit code 1 or 2."""
    store = ["--store", str(area / "store")]
    for words in (
        ["status"],
        ["runs"],
        ["explain", "disc"],
        ["verify"],
        ["repair", "--yes"],
        ["gc", "--yes"],
    ):
        assert main([*words, *store]) in (0, 1, 2)


# ---------------------------------------------------------------------- names of sources
def test_names_of_sources_become_names_in_the_output_folder(sandbox: Sandbox, area: Path) -> None:
    with sandbox.untouched():
        for stem in STEMS:
            (name,) = unique_names([f"{area}/sources/{stem}.mp4"])
            folder = files.below(area / "out", name, one=True)
            assert folder.parent == area / "out"
            assert folder.resolve().parent == (area / "out").resolve()
            assert not name.startswith(".")
            assert title(f"{area}/sources/{stem}.mp4") == name
            output = Output(folder, "x-0123456789abcdef")
            output.claim({})
            output.write("masks/a.png", b"x", "k")
            output.remove_others([])


@pytest.mark.parametrize("stem", ["..", "...", "a\\..\\..\\..", ".zsmoseg.json"])
def test_a_video_with_a_name_that_leads_elsewhere_is_segmented_in_its_folder(
    stem: str, sandbox: Sandbox, area: Path
) -> None:
    source = area / "sources" / f"{stem}.mp4"
    source.parent.mkdir()
    write_mp4(source, draw_clip(0, 3, 96, 128)[0])
    with sandbox.untouched():
        _, counter = segment(source, area, SMALL)
    (plan,) = counter.plans
    assert plan.output.path.parent == area / "out"
    assert (plan.output.path / "masks" / "00000.png").is_file()


def test_two_long_names_that_begin_alike_stay_two() -> None:
    one, two = (f"/x/{'y' * 200}{end}.mp4" for end in "ab")
    names = unique_names([one, two])
    assert len(set(names)) == 2
    assert max(len(os.fsencode(name)) for name in names) < 200


# ---------------------------------------------------------------------- the list in OUT
def test_the_list_in_the_output_folder_leads_nowhere_else(sandbox: Sandbox, area: Path) -> None:
    out = area / "out" / "disc"
    sound = read_record(out / LIST)
    assert sound is not None
    entry = sound["files"]["masks/00000.png"]
    for number, name in enumerate(hostile(COUNT, 1, sandbox.root)):
        listed = {**sound, "files": {**sound["files"], name: entry}}
        if "\0" not in name:  # one that JSON takes, as a writer of lists would
            assert json.loads(json.dumps(listed))
        write_record(out / LIST, listed)
        with sandbox.untouched():
            output = Output(out, sound["video"])
            assert output.listed == stays(name), name
            assert output.problem([name], entry["key"])
            list(output.damages())
            verify(Store.open(area / "store", create=False))
            if number % 10 == 0:
                segment(area / "disc", area, SMALL)
            else:
                output.remove_others(sound["files"])


@pytest.mark.parametrize(
    "damage",
    [
        {"files": []},
        {"files": {"masks/00000.png": 5}},
        {"files": {"masks/00000.png": {"size": "a", "crc32": 1, "stamp": "", "key": ""}}},
        {"files": {LIST: {"size": 1, "crc32": 1, "stamp": "", "key": ""}}},
        {"stages": 3},
        {"stages": {"masks": {"settings": {"masks": 4}}}},
        {"video": ["a"]},
        {"video": None},
    ],
)
def test_a_list_of_another_form_is_made_again(damage: dict[str, Any], sandbox: Sandbox, area: Path) -> None:
    sound = read_record(area / "out" / "disc" / LIST)
    assert sound is not None
    write_record(area / "out" / "disc" / LIST, {**sound, **damage})
    with sandbox.untouched():
        segment(area / "disc", area, SMALL)
    again = read_record(area / "out" / "disc" / LIST)
    assert again is not None
    assert again["files"].keys() == sound["files"].keys()


# ---------------------------------------------------------------------- records of the store
@pytest.mark.parametrize("format", FORMATS)
def test_names_of_frames_in_a_store_do_not_lead_out_of_an_export(
    format: str, sandbox: Sandbox, area: Path
) -> None:
    path = probe_record(area)
    sound = read_record(path)
    assert sound is not None
    assert {"names", "files"} <= sound.keys()
    for number, name in enumerate(hostile(6 if format in SLOW else 27, 2, sandbox.root)):
        write_record(path, {**sound, "names": [name, *sound["names"][1:]], "files": [name] * 4})
        with sandbox.untouched(), suppress(ZsmosegError, ValueError):
            list(
                export([open_store(area / "store")["disc"]], area / "exported" / str(number), choose(format))
            )


@pytest.mark.parametrize("field", ["name", "video", "stage", "key", "out"])
def test_what_runs_remember_does_not_lead_out_of_the_store(field: str, sandbox: Sandbox, area: Path) -> None:
    path = run_record(area)
    sound = read_record(path)
    assert sound is not None
    for name in [*hostile(8, 3, sandbox.root), "../../outside", f"{sandbox.root}/outside"]:
        changed = {
            "name": {"name": name},
            "video": {"video": name},
            "stage": {"keys": {**sound["keys"], name: "k"}},
            "key": {"keys": {**sound["keys"], "flow": name}},
            "out": {"out": f"{area}/out/disc/{name}" if "\0" not in name else name},
        }[field]
        write_record(path, {**sound, **changed})
        store = Store.open(area / "store", create=False)
        with sandbox.untouched(reads=field != "out"):  # whether a list lies there has to be looked at
            with suppress(ZsmosegError):
                remove_garbage(store, garbage(store))
            take_back(store)
            commands(area)
            with suppress(ZsmosegError):
                result = open_store(area / "store")[name if field == "name" else "disc"]
                list(export([result], area / "exported", choose("davis")))
            shutil.rmtree(area / "exported", ignore_errors=True)


@pytest.mark.parametrize("what", ["part", "done", "taken in", "arrays"])
def test_files_that_records_of_artifacts_name_lie_in_the_artifact(
    what: str, sandbox: Sandbox, area: Path
) -> None:
    (video,) = Store.open(area / "store", create=False).videos()
    (artifact,) = Artifact(area / "store" / video / "flow" / "any").siblings()
    if what == "part":
        artifact.unseal()
    path = record_path(artifact, {"part": 0, "arrays": "artifact"}.get(what, "done"))
    sound, text = read_record(path), path.read_bytes()
    assert sound is not None
    for name in hostile(6, 4, sandbox.root):
        write_record(path, _naming(what, sound, name))
        store = Store.open(area / "store", create=False)
        with sandbox.untouched():
            with suppress(ZsmosegError):
                verify(store)
            with suppress(ZsmosegError):
                segment(area / "disc", area, SMALL)
            commands(area)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text)


def _naming(what: str, sound: dict[str, Any], name: str) -> dict[str, Any]:
    """A record with one more file, or array, of the ``name``."""

    def more(record: dict[str, Any], field: str) -> dict[str, Any]:
        return {**record, field: {**record[field], name: next(iter(record[field].values()))}}

    if what == "taken in":
        parts = sound["parts"]
        return {**sound, "parts": {**parts, "0000": more(parts["0000"], "files"), name: parts["0001"]}}
    return more(sound, "arrays" if what == "arrays" else "files")


# ---------------------------------------------------------------------- links
def places(area: Path, seed: int, count: int) -> list[Path]:
    """Files and folders of the store and of OUT, below them."""
    found = sorted(p for top in ("store", "out") for p in (area / top).rglob("*"))
    folders = [p for p in found if p.is_dir()]
    return Random(seed).sample(found, count) + Random(seed).sample(folders, count)


def work(area: Path, forget: bool) -> None:
    """All that writes or removes."""
    store = area / "store"
    for command in (["verify"], ["repair", "--yes"], ["gc", "--yes"]):
        assert main([*command, "--store", str(store)]) in (0, 1, 2)
    with suppress(ZsmosegError):
        run_it(area, **({"masks_when": "now"} if forget else {}))
    with suppress(ZsmosegError):
        opened = Store.open(store, create=False)
        runs = [path.stem for path in opened.runs.glob("*.json") if not path.is_symlink()] if forget else []
        remove_garbage(opened, garbage(opened, runs), runs)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("like", [True, False], ids=["to the same", "to others"])
def test_links_that_we_did_not_make_are_not_written_through(
    seed: int, like: bool, finished: Path, tmp_path: Path
) -> None:
    for number, place in enumerate(places(finished, seed, 2)):
        root = tmp_path / str(number)
        shutil.copytree(finished, root / "area")
        path = root / "area" / place.relative_to(finished)
        target = root / "outside" / "target"
        target.parent.mkdir()
        if like or not path.is_dir():
            path.rename(target)
        else:
            shutil.rmtree(path)
            target.mkdir()
            (target / "canary").write_bytes(b"canary")
        path.symlink_to(target)
        sandbox = Sandbox(root, [root / "area" / name for name in ("disc", "store", "out")])
        with sandbox.untouched(reads=False):
            work(root / "area", forget=seed % 2 == 1)


@pytest.mark.parametrize(
    "place", ["cat-0123456789abcdef", "disc-*/flow/k", "disc-*/flow", "fingerprints/x.json"]
)
def test_gc_goes_round_a_link_and_removes_what_is_garbage(place: str, sandbox: Sandbox, area: Path) -> None:
    folder = next((area / "store").glob("disc-*"))
    link, target = area / "store" / place.replace("disc-*", folder.name), sandbox.root / "outside" / "target"
    if link.exists():
        link.rename(target)
    else:
        shutil.copytree(next(folder.glob("flow/*")), target)
    link.symlink_to(target)
    run = run_record(area).stem.rpartition("-")[0]
    with sandbox.untouched():
        assert main(["gc", "--yes", "--store", str(area / "store"), "--forget", run]) == 0
    assert not folder.exists()
    assert link.is_symlink() or not link.parent.exists()


@pytest.mark.parametrize("place", ["out", "out/disc", "out/disc/masks", "out/disc/.zsmoseg.json"])
def test_an_output_folder_that_is_a_link_is_refused(place: str, sandbox: Sandbox, area: Path) -> None:
    path, target = area / place, sandbox.root / "outside" / "target"
    path.rename(target)
    path.symlink_to(target)
    with sandbox.untouched(reads=False):
        report, message = None, ""
        try:
            report = run_it(area, masks_when="now")
        except ZsmosegError as error:
            message = str(error)
    message = message or "".join(report.failures.values() if report else ())
    assert "is a link" in message or place.endswith("json"), message


def test_a_store_that_the_user_reaches_through_a_link_is_used(area: Path, tmp_path: Path) -> None:
    (area / "store").rename(tmp_path / "large disk")
    (area / "store").symlink_to(tmp_path / "large disk")
    _, counter = segment(area / "disc", area, SMALL)
    assert counter.parts == []
    assert main(["verify", "--store", str(area / "store")]) == 0


def test_nothing_is_exported_through_a_link(sandbox: Sandbox, area: Path) -> None:
    result = open_store(area / "store")["disc"]
    for place in ("exported", "exported/disc", "exported/flow"):
        shutil.rmtree(area / "exported", ignore_errors=True)
        link = area / place
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(sandbox.root / "outside")
        with sandbox.untouched(), pytest.raises(ZsmosegError, match="is a link"):
            list(export([result], area / "exported", choose("flo" if link.name == "flow" else "davis")))
        link.unlink()


@pytest.mark.parametrize(
    "entry", [{"path": 3}, {"path": "a", "fingerprint": "b", "kind": None}, "a", {}, [1]]
)
def test_what_was_imported_before_has_a_form(entry: Any, area: Path) -> None:
    store = Store.open(area / "store", create=False)
    (video,) = store.videos()
    write_record(store.video(video).path / "imports.json", {"flow": entry})
    with pytest.raises(ZsmosegError, match=r"imports\.json: is damaged; zsmoseg import again"):
        brought_before(store, video)


def test_what_is_written_anew_leaves_its_hard_links_as_they_were(tmp_path: Path) -> None:
    """Snapshots of a store are made of those."""
    for write in (files.write, files.write_whole, _append):
        (tmp_path / "snapshot").write_bytes(b"old")
        (tmp_path / "file").unlink(missing_ok=True)
        os.link(tmp_path / "snapshot", tmp_path / "file")
        write(tmp_path / "file", b"new")
        assert (tmp_path / "snapshot").read_bytes() == b"old"
        assert (tmp_path / "file").read_bytes() == b"new"


def _append(path: Path, content: bytes) -> None:
    file = files.Appended(path)
    file.add(content)
    file.close()


# ---------------------------------------------------------------------- imports
def _coco(name: str) -> dict[str, Any]:
    image = {"id": 1, "file_name": name, "height": 8, "width": 8}
    return {"images": [image], "annotations": [], "categories": []}


def _ytvis(name: str) -> dict[str, Any]:
    video = {"id": 1, "name": name, "file_names": ["0.png"], "height": 8, "width": 8}
    return {"videos": [video], "annotations": []}


def _ytvis_files(name: str) -> dict[str, Any]:
    video = {"id": 1, "file_names": [name], "height": 8, "width": 8}
    return {"videos": [video], "annotations": []}


@pytest.mark.parametrize("content", [_coco, _ytvis, _ytvis_files])
def test_names_in_json_lead_nowhere(content: Callable[[str], Any], sandbox: Sandbox, area: Path) -> None:
    folder = area / "brought"
    folder.mkdir()
    for name in hostile(COUNT, 5, sandbox.root):
        (folder / "a.json").write_text(json.dumps(content(name)))
        with sandbox.untouched():
            try:
                source = open_masks(folder / "a.json", "disc")
            except ZsmosegError:
                continue
            assert stays(name.replace("\\", "/")), name
            assert source.frames is not None
            assert all("/" not in frame for frame in source.frames)
            source.read(0)


def test_names_of_videos_and_of_arrays_lead_nowhere(sandbox: Sandbox, area: Path) -> None:
    folder = area / "brought"
    folder.mkdir()
    with zipfile.ZipFile(folder / "model.zip", "w") as archive:
        archive.writestr("model.onnx", b"x")
    for name in hostile(COUNT, 6, sandbox.root):
        safe = name.replace("\0", "0")  # zipfile writes no other
        with zipfile.ZipFile(folder / "a.npz", "w") as archive, archive.open(f"{safe}.npy", "w") as file:
            np.save(file, np.ones((2, 4, 4), np.uint8))
        with zipfile.ZipFile(folder / "b.zip", "w") as archive:
            archive.writestr(f"{safe}/model.onnx", b"x")
            archive.writestr("./", b"")
        with sandbox.untouched():
            with suppress(ZsmosegError):
                found = find_for_video(folder, name)
                assert found.resolve().is_relative_to(folder.resolve())
            with suppress(ModelError):
                unpack(folder / "b.zip", {"model.onnx"}, folder, 10)
            with suppress(ZsmosegError):
                open_masks(folder / "a.npz")
        assert {p.name for p in folder.iterdir()} <= {"a.npz", "b.zip", "model.zip", "model.onnx"}
