"""The Python face, as the README shows it."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import dask.distributed
import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, masks

import zsmoseg
from zsmoseg.errors import SettingsError, StoreError, VideoError, ZsmosegError
from zsmoseg.settings import defaults, resolve

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def result(clip: Path, tmp_path_factory: pytest.TempPathFactory):
    root = tmp_path_factory.mktemp("python")
    return root, zsmoseg.segment(clip, out=root / "out", store=root / "store", progress=False)


def python(*words: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Another interpreter, for which the checkout is on the path."""
    paths = {"PYTHONPATH": str(ROOT), "MYPYPATH": str(ROOT)}
    env = {**os.environ, **paths, **variables}
    return subprocess.run([sys.executable, *words], cwd=cwd, env=env, capture_output=True, text=True)


def test_masks_are_those_of_the_output_folder(result) -> None:
    root, found = result
    for kind, folder in (("group", "masks"), ("instance", "objects")):
        np.testing.assert_array_equal(found.masks(kind).values, masks(root / "out" / "disc", folder))
        assert found.masks(kind).dtype == np.uint8
        assert found.masks(kind).name == kind
    moving = found.masks("moving")
    assert moving.dtype == bool
    assert moving.dims == ("frame", "y", "x")
    assert moving.name == "moving"
    np.testing.assert_array_equal(moving.values, masks(root / "out" / "disc") > 0)


def test_the_tree_holds_every_array_with_units_and_times(result) -> None:
    _, found = result
    flow = found.tree["flow/forward"]
    assert flow.dims == ("pair", "component", "y", "x")
    assert flow.attrs["units"] == "px"
    assert 1.5 < float(abs(flow.sel(component="x")).median()) < 2.5
    np.testing.assert_allclose(found.tree["frames/image"].time, np.arange(10) / 25)


def test_objects_are_a_table_of_what_was_seen(result) -> None:
    _, found = result
    table = found.objects.set_index("object")
    mover = table[table.group == 1].area.idxmax()
    assert table.excess[mover] > table.tolerance[mover]
    assert table.world[mover] < 0.5 < table.world[0]
    assert found.moving()[:, mover].any()


def test_the_store_opens_weeks_later(result) -> None:
    root, found = result
    again = zsmoseg.open_store(root / "store")
    assert list(again) == again._ipython_key_completions_() == ["disc"]
    assert "disc" in again
    assert "cat" not in again
    assert len(again) == 1
    np.testing.assert_array_equal(again["disc"].masks("group"), found.masks("group"))
    with pytest.raises(StoreError, match="no finished run of 'cat'"):
        again["cat"]


def test_a_client_or_the_address_of_a_scheduler_gives_the_same_bytes(
    result, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zsmoseg.workflows.running.run.SMALL", 0.0)
    expected = data_bytes(result[0])
    with (
        dask.distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
        ) as cluster,
        dask.distributed.Client(cluster) as client,
    ):
        for name, scheduler in (("client", client), ("address", cluster.scheduler_address)):
            root = tmp_path / name
            zsmoseg.segment(clip, out=root / "out", store=root / "store", scheduler=scheduler)
            assert data_bytes(root) == expected


@pytest.mark.parametrize("kind", ["closed", "asynchronous"])
def test_a_client_that_cannot_be_asked_is_refused_before_anything_is_written(
    kind: str, clip: Path, tmp_path: Path
) -> None:
    async def refuse(address: str) -> None:
        async with dask.distributed.Client(address, asynchronous=True, set_as_default=False) as client:
            if kind == "closed":
                await client.close()
            with pytest.raises(SettingsError, match=f"Client is {kind}; give one that is connected"):
                zsmoseg.segment(clip, out=tmp_path / "out", store=tmp_path / "store", scheduler=client)

    with dask.distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as cluster:
        asyncio.run(asyncio.wait_for(refuse(cluster.scheduler_address), 60))
    assert list(tmp_path.iterdir()) == []


def test_bad_input_is_one_error_of_the_tree(tmp_path: Path) -> None:
    with pytest.raises(ZsmosegError, match=r"walk\.mp4"):
        zsmoseg.segment(tmp_path / "walk.mp4", out=tmp_path / "out", store=tmp_path / "store")


@pytest.mark.parametrize(("most", "dtype"), [(255, np.uint8), (256, np.uint16), (70_000, np.uint32)])
def test_masks_are_the_smallest_integers_that_hold_them(result, monkeypatch, most: int, dtype: type) -> None:
    _, found = result
    groups = found.groups
    larger = type("Larger", (), {"group": np.where(groups.group > 0, most, 0), "instance": groups.instance})
    monkeypatch.setattr(type(found), "groups", larger)
    group = found.masks("group")
    assert group.dtype == dtype
    assert int(group.max()) == most


@pytest.mark.parametrize("kind", ["nonsense", "groups", "", None, 1])
def test_masks_of_no_kind_are_refused(result, kind: Any) -> None:
    with pytest.raises(SettingsError, match="expected one of moving, group, instance"):
        result[1].masks(kind)


def test_a_result_says_what_it_was_made_with_and_warns_of(result) -> None:
    root, found = result
    written = json.loads((root / "out" / "disc" / "summary.json").read_text())
    assert found.summary == written
    assert found.settings == written["settings"] == dict(defaults())
    assert found.warnings == written["warnings"]
    (root / "out" / "disc" / "summary.json").rename(root / "aside")
    try:
        with pytest.raises(StoreError, match="no summary of this result"):
            _ = found.summary
    finally:
        (root / "aside").rename(root / "out" / "disc" / "summary.json")


def test_results_and_stores_print_what_a_person_can_read(result) -> None:
    root, found = result
    text = repr(found)
    for part in ("disc, run ", "10 frames of 160 x 120 px", "1 moving group", "masks()"):
        assert part in text
    for warning in found.warnings:
        assert f"warning: {warning}" in text
    page = found._repr_html_()
    assert "1 moving group" in page
    assert "<table" in page
    assert "<th>excess</th>" in page
    store = zsmoseg.open_store(root / "store")
    for shown in (repr(store), store._repr_html_()):
        assert "1 finished video" in shown
        assert "disc" in shown


def test_a_result_that_was_stopped_early_or_is_damaged_prints_too(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from zsmoseg.workflows.cli import main

    assert (
        main(["run", str(clip), "-o", str(tmp_path / "out"), "--until", "flow", "--scheduler", "serial"]) == 0
    )
    found = zsmoseg.open_store(tmp_path / "zsmoseg-store")["disc"]
    assert "stopped early (--until), has flow, frames" in repr(found)
    assert "stopped early (--until), has flow, frames" in found._repr_html_()
    for probe in (tmp_path / "zsmoseg-store").rglob("probes/*"):
        probe.unlink()
    assert "its probe is gone or damaged" in repr(found)


def test_progress_is_shown_told_or_neither(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told: list[tuple[int, int, str]] = []

    def segment(name: str, **more: Any) -> str:
        zsmoseg.segment(clip, out=tmp_path / name / "out", store=tmp_path / name / "store", **more)
        return capsys.readouterr().err

    assert "moving group" in segment("shown")
    assert segment("quiet", progress=False) == ""
    assert segment("told", progress=lambda *how: told.append(how)) == ""
    done, parts, stages = zip(*told, strict=True)
    assert list(done) == list(range(len(told)))
    assert done[-1] == parts[-1] > 0
    assert stages[0] == "planned"
    assert {"flow", "groups", "masks"} <= set(stages)
    told.clear()
    segment("told", progress=lambda *how: told.append(how))
    assert told == [(0, 0, "planned")], "everything is there"


def test_what_progress_raises_ends_the_run_and_what_is_finished_is_kept(clip: Path, tmp_path: Path) -> None:
    def stop(done: int, parts: int, what: str) -> None:
        if what == "flow":
            raise InterruptedError("enough")

    with pytest.raises(ZsmosegError, match="enough"):
        zsmoseg.segment(clip, out=tmp_path / "out", store=tmp_path / "store", progress=stop)
    told: list[str] = []
    zsmoseg.segment(
        clip, out=tmp_path / "out", store=tmp_path / "store", progress=lambda _, __, what: told.append(what)
    )
    assert "flow" not in told
    assert "groups" in told


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"groups": True}, "groups.count = True: expected auto or an integer"),
        ({"groups": "banana"}, "groups.count = 'banana': expected auto or an integer"),
        ({"groups": 0}, "groups.count = 0"),
        ({"groups": 3, "settings": {"groups.count": 2}}, "give one of them"),
        ({"settings": {"flow.stride": True}}, "flow.stride = True: expected an integer"),
        ({"settings": {"flow.sride": 2}}, "did you mean flow.stride"),
        ({"workers": 0}, "workers = 0"),
        ({"workers": True, "scheduler": "serial"}, "workers = True"),
        ({"workers": 2, "scheduler": "serial"}, "expected 1 or more, with scheduler 'local' or none"),
        ({"preset": "default"}, "is embedded now"),
        ({"scheduler": 5}, "scheduler: is of type int"),
        ({"scheduler": object()}, "scheduler: is of type object"),
        ({"scheduler": "banana"}, "is no address of a scheduler"),
        ({"preset": ["embedded"]}, "preset ['embedded'] is unknown"),
        ({"preset": None}, "preset None is unknown"),
        ({"settings": ["a=b"]}, "settings are of type list; give a mapping"),
        ({"settings": "groups.count=2"}, "settings are of type str; give a mapping"),
        ({"settings": []}, "settings are of type list; give a mapping"),
        ({"settings": {5: 1}}, "5 is no name"),
        ({"settings": {None: 1, "flow.cut": 7}}, "None is no name; names are section.name | flow.cut = 7"),
        ({"settings": {"video.start": -1.5}}, "video.start = '-1.5': expected seconds"),
        ({"groups": [2]}, "groups are of type list"),
        ({"groups": np.zeros(3)}, "groups are of type ndarray"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_written(
    clip: Path, tmp_path: Path, given: dict[str, Any], says: str
) -> None:
    with pytest.raises(SettingsError) as error:
        zsmoseg.segment(clip, out=tmp_path / "out", store=tmp_path / "store", **given)
    assert says in str(error.value)
    assert list(tmp_path.iterdir()) == []


NO_PATHS = (None, b"walk.mp4", ["walk.mp4"], ("a", "b"), np.zeros((4, 8, 8, 3), np.uint8), 3, True, {"a": 1})


@pytest.mark.parametrize("value", NO_PATHS, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize("name", ["source", "out", "store", "path", "config"])
def test_what_is_no_path_is_refused_by_its_type(
    name: str, value: Any, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if name == "config" and value is None:
        return
    given: dict[str, Any] = {"source": clip, name: value}
    call = {"path": zsmoseg.open_store, "config": lambda v: resolve(config=v)}
    with pytest.raises(SettingsError) as error:
        call.get(name, lambda v: zsmoseg.segment(**given))(value)
    assert str(error.value) == (
        f"{name} is of type {type(value).__name__}; give one path or URL, as text or pathlib.Path"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [0, None, 1.5, b"disc", ["disc"], slice(2)])
def test_a_store_is_asked_by_name(name: Any, result) -> None:
    store = zsmoseg.open_store(result[0] / "store")
    with pytest.raises(SettingsError, match=rf"of type {type(name).__name__}; give one of those that"):
        store[name]
    assert name not in store
    with pytest.raises(StoreError, match="no finished run 7 of 'disc'"):
        store.get("disc", 7)  # type: ignore[arg-type]


def test_a_scheduler_that_is_none_is_refused_where_nothing_is_left_to_do(clip: Path, result) -> None:
    root, _ = result
    with pytest.raises(SettingsError, match="--scheduler 'nope': is no address of a scheduler"):
        zsmoseg.segment(clip, out=root / "out", store=root / "store", scheduler="nope", progress=False)


@pytest.mark.parametrize("value", [1.5, 2, np.float32(0.25), np.int64(3), 1e-5])
def test_times_may_be_numbers_of_seconds(value: Any) -> None:
    chosen = resolve(overrides={"video.start": value, "video.end": value}).video
    assert chosen.start == chosen.end
    assert float(chosen.start) == value
    assert "e" not in chosen.start


@pytest.mark.parametrize("name", [n for n, value in defaults().items() if not isinstance(value, bool)])
def test_a_truth_value_is_no_number_and_no_text(name: str) -> None:
    for value in (True, False, [True]):
        with pytest.raises(SettingsError):
            resolve(overrides={name: value})


def test_paths_and_numbers_of_numpy_are_settings(tmp_path: Path) -> None:
    chosen = resolve(
        overrides={"proposals.path": tmp_path, "groups.count": np.int64(3), "flow.cut": np.float32(0.5)}
    )
    assert chosen.proposals.path == str(tmp_path)
    assert chosen.groups.count == 3


def test_a_folder_of_videos_is_not_one_video(tmp_path: Path) -> None:
    images = draw_clip(frames=2, height=24, width=32)[0]
    for name in ("ant", "bee"):
        write_folder(tmp_path / "data" / name, images)
    with pytest.raises(VideoError, match=r"holds 2 videos, ant, bee"):
        zsmoseg.segment(tmp_path / "data", out=tmp_path / "out", store=tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_what_is_offered_is_completed_and_loaded_when_it_is_used(tmp_path: Path) -> None:
    script = """
import sys, zsmoseg
assert {*zsmoseg.__all__} <= {*dir(zsmoseg)}
assert not {"numpy", "pydantic", "dask", "numba", "zsmoseg.workflows"} & sys.modules.keys()
for name in zsmoseg.__all__:
    getattr(zsmoseg, name)
assert callable(zsmoseg.segment) and "zsmoseg.workflows.segmenting" in sys.modules
assert "distributed" not in sys.modules and "matplotlib" not in sys.modules
"""
    found = python("-c", script, cwd=tmp_path)
    assert found.returncode == 0, found.stderr


SCRIPTS = {
    "good": (
        """
from pathlib import Path
import zsmoseg
def tell(done: int, parts: int, what: str) -> None: ...
result = zsmoseg.segment(Path("walk.mp4"), groups=3, settings={"flow.stride": 2}, workers=2, progress=tell)
moving = result.masks("moving").values.sum()
names: list[str] = [*zsmoseg.open_store("store"), *result.warnings, *result.categories]
count: int = zsmoseg.settings.resolve("paper").flow.stride
again = zsmoseg.segment("a.mp4", groups="auto", scheduler="tcp://host:8786", progress=False)
video = zsmoseg.synthetic.render
""",
        "",
    ),
    "banana": ('import zsmoseg\nzsmoseg.segment("a.mp4", groups="banana")\n', "arg-type"),
    "masks": ('import zsmoseg\nx: int = zsmoseg.segment("a.mp4").masks()\n', "assignment"),
    "kind": ('import zsmoseg\nzsmoseg.open_store("s")["a"].masks("nonsense")\n', "arg-type"),
    "progress": ('import zsmoseg\nzsmoseg.segment("a.mp4", progress="yes")\n', "arg-type"),
    "workers": ('import zsmoseg\nzsmoseg.segment("a.mp4", workers="2")\n', "arg-type"),
    "named": ('import zsmoseg\nzsmoseg.segment("a.mp4", group=2)\n', "call-arg"),
    "offered": ("from zsmoseg import segmnt\n", "attr-defined"),
    "setting": ("import zsmoseg\nx: str = zsmoseg.settings.resolve().flow.stride\n", "assignment"),
}


def test_mypy_knows_what_is_offered(tmp_path: Path) -> None:
    """Strict, over scripts as users write them: what is right passes, each mistake is found in its line."""
    pytest.importorskip("mypy", reason="mypy is not installed (pip install zsmoseg[dev])")
    for name, (text, _) in SCRIPTS.items():
        (tmp_path / f"{name}.py").write_text(text)
    files = [f"{name}.py" for name in SCRIPTS]
    found = python("-m", "mypy", "--strict", "--follow-imports=silent", *files, cwd=tmp_path)
    wrong = {name: code for name, (_, code) in SCRIPTS.items() if code}
    lines = [line for line in found.stdout.splitlines() if ": error:" in line]
    assert {line.split(".py:")[0]: line.rpartition("[")[2].rstrip("]") for line in lines} == wrong, (
        found.stdout
    )
    assert len(lines) == len(wrong)
