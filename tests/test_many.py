"""Many videos: planned when their turn comes, remembered one by one, shared with other runs."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from conftest import draw_clip, write_folder
from runs import Counter, data_bytes, masks, segment

from zsmoseg.settings import resolve
from zsmoseg.stores import leases
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import LEASE
from zsmoseg.stores.runs import entries, latest, list_runs
from zsmoseg.stores.upkeep import garbage, verify
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running import run as running
from zsmoseg.workflows.running.request import Choice, Quiet, Request
from zsmoseg.workflows.running.run import run

RUN = "import sys; from zsmoseg.workflows.cli import main; sys.exit(main(sys.argv[1:]))"
TINY = {"overlay.write": False}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine tiny videos."""
    root = tmp_path_factory.mktemp("many") / "data"
    for seed in range(9):
        write_folder(root / f"v{seed}", draw_clip(seed, 4, 48, 64)[0])
    return root


class Course(Counter):
    """What is said, in order."""

    def __init__(self, when: str = "", do: Callable[[], Any] = lambda: None) -> None:
        super().__init__()
        self.said: list[str] = []
        self.notes: list[str] = []
        self.when, self.do = when, do

    def planned(self, plan: VideoPlan) -> None:
        super().planned(plan)
        self.say(f"planned {plan.name}")

    def finished(self, plan: VideoPlan, summary: Any) -> None:
        self.say(f"finished {plan.name}")

    def note(self, text: str) -> None:
        self.notes.append(text)
        self.say(text.partition(" ")[0])

    def say(self, text: str) -> None:
        self.said.append(text)
        if text == self.when:
            self.do()


def batch(data: Path, root: Path, watcher: Quiet, settings: Any = None, **more: Any) -> running.Report:
    chosen = resolve(overrides={**TINY, **(settings or {})})
    return run(Request([str(data)], root / "out", root / "store", chosen, "serial", **more), watcher)


def test_videos_are_planned_while_others_are_computed(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "LOOK", (2, 2))
    course = Course()
    report = batch(data, tmp_path, course)
    assert report.finished == [f"v{n}" for n in range(9)]
    assert course.said.index("planned v8") > course.said.index("finished v2")
    ahead = [
        sum(s.startswith("planned") for s in course.said[:n])
        - sum(s.startswith("fin") for s in course.said[:n])
        for n in range(len(course.said))
    ]
    assert max(ahead) <= 5
    again = Course()
    assert batch(data, tmp_path, again).finished == report.finished
    assert not again.parts
    assert again.said[:4] == ["planned v0", "finished v0", "planned v1", "finished v1"], "nothing piles up"


def test_each_video_has_a_record_of_its_own_in_every_run(data: Path, tmp_path: Path) -> None:
    first = batch(data, tmp_path, Quiet(), choice=Choice(only=["v[0-2]"]))
    second = batch(data, tmp_path, Quiet(), {"groups.count": 1}, choice=Choice(only=["v1"]))
    store = Store.open(tmp_path / "store", create=False)
    assert [run["names"] for run in list_runs(store)] == [["v0", "v1", "v2"], ["v1"]]
    found = latest(store)
    assert {name: entry.run for name, entry in found.items()} == {
        "v0": first.run,
        "v1": second.run,
        "v2": first.run,
    }
    assert {entry.outcome for entry in found.values()} == {"done"}
    (old, new) = entries(store, "v1")
    assert old.keys["flow"] == new.keys["flow"]
    assert old.keys["groups"] != new.keys["groups"] == found["v1"].keys["groups"]
    assert found["v1"].out == str(tmp_path / "out" / "v1")
    assert not garbage(store).paths
    assert not verify(store)


def test_a_record_of_a_video_that_lies_with_another_counts_for_nothing(data: Path, tmp_path: Path) -> None:
    batch(data, tmp_path, Quiet(), choice=Choice(only=["v[01]"]))
    one, two = sorted((tmp_path / "store").glob("v*/runs"))
    (path,) = one.iterdir()
    (other,) = two.iterdir()
    for stray in (two / path.name, two / other.name):
        stray.write_bytes(path.read_bytes())
    store = Store.open(tmp_path / "store", create=False)
    assert [entry.name for entry in entries(store)] == ["v0"]
    assert {damage.path for damage in verify(store)} == {two / path.name, two / other.name}


def test_names_that_an_interrupted_run_did_not_come_to_are_retried(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "LOOK", (1, 1))

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch(data, tmp_path, Course("finished v1", stop))
    assert not list(tmp_path.rglob("*.lease"))
    report = batch(data, tmp_path, Quiet(), choice=Choice(retry_failed=True))
    assert report.finished == [f"v{n}" for n in range(2, 9)]


def test_one_content_under_two_names_is_computed_once(tmp_path: Path) -> None:
    for name in "abc":
        write_folder(tmp_path / "data" / name, draw_clip(0, 4, 48, 64)[0])
    counter = Counter()
    report = batch(tmp_path / "data", tmp_path, counter)
    assert report.finished == ["a", "b", "c"]
    assert counter.parts.count(("flow", 0)) == 1
    assert counter.parts.count(("masks", 0)) == 3
    store = Store.open(tmp_path / "store", create=False)
    assert len(store.videos()) == 1
    assert sorted(latest(store)) == ["a", "b", "c"]


# ---------------------------------------------------------------------- two runs into one OUT
@pytest.mark.parametrize("other", [{}, {"groups.count": 1}], ids=["same", "other"])
def test_a_video_that_another_run_works_on_comes_later_and_is_looked_at_again(
    other: dict[str, Any], data: Path, tmp_path: Path
) -> None:
    """While the first run is at its first video, a second one over the same videos begins and ends."""
    second = Course("waiting")
    reports: list[running.Report] = []

    def work() -> None:
        reports.append(batch(data, tmp_path, second, other, choice=Choice(only=["v[01]"])))

    thread = threading.Thread(target=work)

    def start() -> None:
        thread.start()
        while not second.notes:
            time.sleep(0.05)

    first = batch(data, tmp_path, Course("planned v0", start), choice=Choice(only=["v0"]))
    thread.join()
    assert (first.finished, reports[0].finished) == (["v0"], ["v1", "v0"])
    assert f"{tmp_path}/out/v0" in second.notes[0]
    assert second.said.index("finished v1") < second.said.index("waiting")
    done = [stage for (stage, _), name in zip(second.parts, second.videos, strict=True) if name == "v0"]
    assert done == (["groups", "masks", "overlay"] if other else [])
    segment(data / "v0", tmp_path / "alone", {**TINY, **other})
    np.testing.assert_array_equal(masks(tmp_path / "out/v0"), masks(tmp_path / "alone/out/v0"))
    assert not list(tmp_path.rglob("*.lease"))


def test_a_run_that_was_killed_holds_no_output_folder(data: Path, tmp_path: Path) -> None:
    words = ["run", str(data / "v0"), "-o", str(tmp_path / "out"), "--store", str(tmp_path / "store")]
    with subprocess.Popen(
        [sys.executable, "-c", RUN, *words, "--scheduler", "serial"], stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        while b"frames done" not in process.stderr.readline():
            assert process.poll() is None
        process.kill()
    held = tmp_path / "out" / "v0" / LEASE
    assert held.exists()
    assert batch(data, tmp_path, Quiet(), choice=Choice(only=["v0"])).finished == ["v0"]
    assert not held.exists()


def foreign(path: Path, age: float) -> None:
    """A lease of another machine, touched ``age`` seconds ago."""
    import os

    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"host": "elsewhere", "pid": psutil.Process().pid, "started": 0.0}))
    now = time.time()
    os.utime(path, (now - age, now - age))


def test_only_a_lease_that_has_expired_is_stolen(tmp_path: Path) -> None:
    for age, stolen in ((leases.EXPIRY / 3, False), (leases.EXPIRY + 5, True)):
        path = tmp_path / f"{age}.lease"
        foreign(path, age)
        with lease(path, wait=False) as ours:
            assert not ours, "without --steal it is watched"
        with lease(path, wait=False, steal=True) as ours:
            assert ours == stolen
        assert path.exists() == (not stolen)


def test_stealing_takes_an_output_folder_whose_holder_is_gone_at_once(data: Path, tmp_path: Path) -> None:
    foreign(tmp_path / "out" / "v0" / LEASE, leases.EXPIRY + 5)
    course = Course()
    report = batch(data, tmp_path, course, choice=Choice(only=["v0"]), steal=True)
    assert report.finished == ["v0"]
    assert not course.notes


# ---------------------------------------------------------------------- tiny videos on Dask
@pytest.mark.parametrize("tiny", [0.0, 1e9], ids=["parts", "whole"])
def test_a_tiny_video_is_one_task_and_leaves_the_same(
    tiny: float, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.workflows.running.cluster import Dask

    monkeypatch.setattr("zsmoseg.workflows.running.driving.TINY", tiny)
    monkeypatch.setattr(running, "SMALL", 0.0)
    tasks: list[str] = []
    submit = Dask._submit

    def counted(self: Dask, job: Any, *more: Any) -> None:
        tasks.append(job.name)
        submit(self, job, *more)

    monkeypatch.setattr(Dask, "_submit", counted)
    (tmp_path / "some").mkdir()
    for name in ("v0", "v1"):
        (tmp_path / "some" / name).symlink_to(data / name)
    settings = {"chunk.length": 4}
    report, counter = segment(tmp_path / "some", tmp_path / "dask", settings, scheduler="local", workers=1)
    assert report.finished == ["v0", "v1"]
    assert len(tasks) == (2 if tiny else len(counter.parts))
    _, serial = segment(tmp_path / "some", tmp_path / "serial", settings)
    assert sorted(counter.parts) == sorted(serial.parts)
    assert data_bytes(tmp_path / "dask" / "store") == data_bytes(tmp_path / "serial" / "store")


def test_a_part_that_fails_in_a_tiny_video_is_named_and_the_rest_is_skipped(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.workflows.running import whole
    from zsmoseg.workflows.running.jobs import Job, Outcome

    def job(part: int) -> Job:
        return Job("", "video", "stage", "k" * 12, part, part, part + 1, "", {}, {})

    def failing(job: Job, *before: Outcome) -> Outcome:
        return Outcome(
            "skipped" if any(o.state != "done" for o in before) else "failed" if job.part else "done"
        )

    monkeypatch.setattr(whole, "run_job", failing)
    jobs = [(job(0), []), (job(1), [job(0).name]), (job(2), [job(1).name])]
    assert [o.state for o in whole.run_jobs(jobs).values()] == ["done", "failed", "skipped"]
    died = whole.all_failed(jobs, Outcome("failed", error="killed"))
    assert [(o.state, o.error) for o in died.values()] == [
        ("failed", "killed"),
        ("skipped", ""),
        ("skipped", ""),
    ]


def test_a_worker_with_other_code_under_the_same_version_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from zsmoseg.workflows.running import workers

    record = tmp_path / "run.json"
    record.touch()
    needs = workers.Needs.of(tmp_path, record, [], [])
    assert workers.look(needs) is None
    package = tmp_path / "zsmoseg"
    package.mkdir()
    (package / "__init__.py").write_text("changed = True\n")
    monkeypatch.setattr(workers.zsmoseg, "__path__", [str(package)])
    workers.code.cache_clear()
    try:
        assert "has other code" in (workers.look(needs) or "")
    finally:
        workers.code.cache_clear()
