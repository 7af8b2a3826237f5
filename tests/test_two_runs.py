"""Two runs on one store: each part is computed once, what is finished stays, both end right."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import draw_clip, write_folder
from runs import data_bytes, masks, segment

from zsmoseg.stores import files, leases
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import Store

RUN = "import sys; from zsmoseg.workflows.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("clips") / "disc", draw_clip(0, 12)[0])


@pytest.mark.parametrize(
    "settings", [["chunk.length=4", "chunk.length=4"], ["chunk.length=3", "chunk.length=5"]]
)
def test_two_coordinators_end_right_and_compute_each_part_once(
    settings: list[str], clip: Path, tmp_path: Path
) -> None:
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", RUN, "run", str(clip), "--store", str(tmp_path / "store"), "-o", str(tmp_path / out),
             "--scheduler", "serial", "--set", chunk],
            stderr=subprocess.PIPE,
            text=True,
        )
        for out, chunk in zip("ab", settings, strict=True)
    ]  # fmt: skip
    told = [run.communicate(timeout=240)[1] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], told
    segment(clip, tmp_path / "alone")
    for out in "ab":
        np.testing.assert_array_equal(masks(tmp_path / out / "disc"), masks(tmp_path / "alone/out/disc"))
    assert not list((tmp_path / "store").rglob("*.lease"))
    store = Store.open(tmp_path / "store", create=False)
    assert {a.path.parent.name for a in store.artifacts() if a.done} >= {"frames", "flow", "labels", "groups"}
    if settings[0] == "chunk.length=4":
        assert data_bytes(tmp_path / "store") == data_bytes(tmp_path / "alone" / "store")


def _hold(path: Path, held: str) -> None:
    with lease(path):
        Path(held).touch()
        time.sleep(600)


def test_a_lease_of_a_process_that_was_killed_is_nobodys_at_once(tmp_path: Path) -> None:
    path, held = tmp_path / "part.lease", tmp_path / "held"
    holder = multiprocessing.get_context("spawn").Process(target=_hold, args=(path, str(held)))
    holder.start()
    while not held.exists():
        time.sleep(0.05)
    waited = threading.Event()
    with lease(path, lambda: waited.set() or True) as ours:
        assert not ours, "it is held, and there is nothing left to do"
    assert waited.is_set()
    holder.kill()
    holder.join()
    assert path.exists()
    with lease(path) as ours:
        assert ours
    assert not path.exists()


def test_leases_of_killed_runs_are_swept_and_those_of_others_stay(tmp_path: Path) -> None:
    import psutil

    gone = {"host": leases.socket.gethostname(), "pid": psutil.Process().pid, "started": 0.0}
    for name, held in (("gone", gone), ("other", {**gone, "host": "elsewhere"})):
        (tmp_path / f"{name}.begin.lease").write_text(json.dumps(held))
    with lease(tmp_path / "mine.begin.lease"):
        leases.sweep(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {"other.begin.lease", "mine.begin.lease"}


def test_a_lease_of_another_machine_is_nobodys_when_it_stops_beating(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "part.lease"
    path.write_text(json.dumps({"host": "elsewhere", "pid": 1, "started": 0.0}))
    monkeypatch.setattr(leases, "EXPIRY", 1.0)
    beats = 0

    def beating() -> bool:
        nonlocal beats
        beats += 1
        if beats < 10:  # longer than the expiry, all in all
            files.touch(path)
        return False

    with lease(path, beating) as ours:
        assert ours
    assert beats > 10, "while it beats it is somebody's"


def test_a_lease_that_stands_since_long_ago_needs_no_watching(tmp_path: Path) -> None:
    import os

    path = tmp_path / "part.lease"
    path.write_text("not even JSON")
    os.utime(path, (1, 1))
    looks: list[int] = []
    with lease(path, lambda: looks.append(1) is not None) as ours:
        assert ours
    assert len(looks) <= 2


def test_many_that_want_one_lease_hold_it_one_at_a_time(tmp_path: Path) -> None:
    path, inside, most = tmp_path / "part.lease", [], []

    def work() -> None:
        for _ in range(5):
            with lease(path):
                inside.append(1)
                most.append(len(inside))
                time.sleep(0.002)
                inside.pop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(most) == 20
    assert max(most) == 1
