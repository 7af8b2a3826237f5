"""Clusters in every state: each has its line and its end, and what was finished is kept."""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread, Timer
from typing import Any

import av
import cv2
import dask
import distributed  # noqa: F401  # its defaults are there before a test changes one
import numpy as np
import pytest
from clusters import Cluster, certificate, cluster, job, kill, pretend, until
from conftest import draw_clip
from runs import data_bytes, masks, segment

from zsmoseg import __version__
from zsmoseg.errors import ClusterError, SettingsError
from zsmoseg.settings import resolve
from zsmoseg.workflows.cli import main
from zsmoseg.workflows.cli.run import execution_options
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running import cluster as module
from zsmoseg.workflows.running import deadlines, driving, local_cluster, scheduler
from zsmoseg.workflows.running.cluster import Dask
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet, Report, Request
from zsmoseg.workflows.running.run import dry_run, run
from zsmoseg.workflows.running.workers import Needs, look

ROOT = Path(__file__).parents[1]
BRIEF = 2.0
"""Patience where nothing is to come."""


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler; tests start workers and kill them."""
    with cluster(tmp_path_factory.mktemp("idle"), workers=0) as made:
        yield made


@pytest.fixture
def empty(idle: Cluster) -> Iterator[Cluster]:
    yield idle
    idle.kill_workers()


@pytest.fixture
def pretending(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "run_job", pretend)


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The seconds that Dask waits: many, as workers may start slowly, until a test has what it wants to lose."""
    limit = [60.0]
    short = property(lambda _: limit[0], lambda _, given: None)
    monkeypatch.setattr(Dask, "_patience", short, raising=False)
    return limit


def tries(log: Path) -> list[int]:
    return [int(line) for line in log.read_text().split()] if log.exists() else []


# ------------------------------------------------------------------ no workers
def test_no_workers_from_the_start_are_waited_for_with_a_word_and_then_given_up(
    clip: Path, empty: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ["--scheduler", str(empty.file), "--patience", str(BRIEF)]
    code = main(["run", str(clip), "-o", str(tmp_path / "out"), *where])
    err = capsys.readouterr().err
    assert code == 2
    assert f"waiting for workers of {empty.file} (2 s at most, --patience)" in err
    (line,) = [line for line in err.splitlines() if line.startswith("zsmoseg:")]
    assert f"no workers of {empty.file} for" in line
    assert "start workers and run the same command again" in line


@pytest.mark.usefixtures("pretending")
def test_workers_that_come_late_go_and_come_again_do_all_the_work(empty: Cluster, tmp_path: Path) -> None:
    """As with an adaptive cluster: it starts workers when a task waits for one."""
    said: list[str] = []

    def come(text: str) -> None:
        said.append(text)
        empty.worker()

    log = tmp_path / "log"
    with Dask(str(empty.file), patience=60, say=come) as executor:
        for part in range(4):
            executor.submit(job(part, log, 0.3), [], -part)
        came = []
        for name, outcome in executor.results():
            came.append((name, outcome.state))
            if len(came) == 1:
                empty.kill_workers()
    assert len(said) == 2
    assert sorted(state for _, state in came) == ["done"] * 4
    assert len({name for name, _ in came}) == 4


@pytest.mark.usefixtures("pretending")
def test_an_adaptive_cluster_of_somebody_starts_workers_for_the_run_and_stays_open(tmp_path: Path) -> None:
    from distributed import Client, LocalCluster

    quiet: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "worker_dashboard_address": "127.0.0.1:0"}
    with LocalCluster(n_workers=0, threads_per_worker=2, host="127.0.0.1", **quiet) as theirs:
        theirs.adapt(minimum=0, maximum=1, interval="200ms")
        with Client(theirs) as client:
            with Dask(client, patience=60) as executor:
                for part in range(3):
                    executor.submit(job(part, tmp_path / "log"), [], -part)
                assert [outcome.state for _, outcome in executor.results()] == ["done"] * 3
            assert client.status == "running"


def test_a_cluster_behind_tls_takes_who_has_a_certificate_and_nobody_else(
    clip: Path, tmp_path: Path, expected: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [str(path) for path in certificate(tmp_path)]
    names = ["--tls-ca-file", "--tls-cert", "--tls-key"]
    words = [word for pair in zip(names, [paths[0], *paths], strict=True) for word in pair]
    mine = dict(zip(("ca-file", "client.cert", "client.key"), [paths[0], *paths], strict=True))
    run_it = ["run", str(clip), "-o", str(tmp_path / "out"), "--set", "chunk.length=4", "--scheduler"]
    with cluster(tmp_path / "tls", 1, "--protocol", "tls", *words) as made:
        address = json.loads(made.file.read_text())["address"]
        assert address.startswith("tls://")
        with dask.config.set({f"distributed.comm.tls.{name}": path for name, path in mine.items()}):
            assert main([*run_it, str(made.file)]) == 0
        np.testing.assert_array_equal(masks(tmp_path / "out" / "disc"), expected)
        capsys.readouterr()
        assert main([*run_it, address, "--from", "groups"]) == 2
        (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("zsmoseg:")]
        assert f"--scheduler {address}: no Dask scheduler answers there" in line


@pytest.mark.parametrize(("threads", "processes"), [(2, True), (4, True), (4, False)])
def test_threads_of_a_worker_share_no_decoder_and_leave_the_same_bytes(
    threads: int, processes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What ``dask worker`` and ``Client()`` start: tasks side by side in one process, or in that of the caller."""
    from distributed import Client, LocalCluster

    monkeypatch.setattr("zsmoseg.workflows.running.run.SMALL", 0.0)
    monkeypatch.setattr(driving, "TINY", 0.0)  # a task a part
    clip = tmp_path / "disc.mp4"
    with av.open(str(clip), "w") as out:
        stream = out.add_stream("libx264", 25)
        stream.width, stream.height, stream.pix_fmt, stream.options = 128, 96, "yuv420p", {"g": "30"}
        for image in draw_clip(0, 24, 96, 128)[0]:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        out.mux(stream.encode())
    segment(clip, tmp_path / "alone")
    place: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "worker_dashboard_address": "127.0.0.1:0"}
    before = cv2.getNumThreads()
    with (
        LocalCluster(n_workers=1, threads_per_worker=threads, processes=processes, **place) as theirs,
        Client(theirs) as client,
    ):
        segment(clip, tmp_path / "beside", scheduler=client)
    assert cv2.getNumThreads() == before
    assert data_bytes(tmp_path / "beside") == data_bytes(tmp_path / "alone")


@pytest.mark.usefixtures("pretending")
def test_a_job_that_needs_a_gpu_does_not_wait_for_ever_for_one_that_is_gone(
    empty: Cluster, tmp_path: Path, patience: list[float]
) -> None:
    with_gpu = empty.worker("--resources", "GPU=1")
    empty.worker()
    executor = Dask(str(empty.file))

    def all_of_it() -> None:
        with executor:
            executor.submit(job(0, tmp_path / "log", 60.0, network=True), [], 0)
            executor.submit(job(1, tmp_path / "other", network=False), [job(0, tmp_path).name], 0)
            until(lambda: tries(tmp_path / "log") == [0])
            until(lambda: len(executor._client.scheduler_info()["workers"]) == 2)
            patience[0] = BRIEF
            kill(with_gpu)
            list(executor.results())

    with pytest.raises(ClusterError, match="with a GPU"):
        all_of_it()


# ------------------------------------------------------------------ lost results
@pytest.mark.usefixtures("pretending")
@pytest.mark.parametrize("again", [True, False])
def test_a_result_that_died_with_its_worker_is_made_again_or_given_up(
    again: bool, empty: Cluster, tmp_path: Path, patience: list[float]
) -> None:
    empty.worker()
    log = tmp_path / "log"

    def all_of_it() -> list[tuple[str, Outcome]]:
        with Dask(str(empty.file)) as executor:
            executor.submit(job(0, log), [], 0)
            until(lambda: executor._futures[job(0, log).name].status == "finished")
            empty.kill_workers()
            if again:
                empty.worker()
            else:
                patience[0] = BRIEF
            return list(executor.results())

    if again:
        ((_, outcome),) = all_of_it()
        assert outcome.state == "done"
        assert tries(log) == [0, 0]
    else:
        with pytest.raises(ClusterError, match=r"no workers of .* for"):
            all_of_it()


@pytest.mark.usefixtures("pretending")
@pytest.mark.parametrize("wakes", [True, False])
def test_a_scheduler_that_does_not_answer_is_waited_for_and_then_given_up(
    wakes: bool, empty: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, patience: list[float]
) -> None:
    monkeypatch.setattr(module, "CLOSING", 0.2)
    empty.worker()
    said: list[str] = []

    def note(text: str) -> None:
        said.append(text)
        if wakes:
            empty.scheduler.send_signal(signal.SIGCONT)

    def all_of_it() -> list[tuple[str, Outcome]]:
        monkeypatch.setattr(module, "CONNECT", 10.0)
        with Dask(str(empty.file), say=note) as executor:
            executor.submit(job(0, tmp_path / "log", 0.5), [], 0)
            until(lambda: tries(tmp_path / "log") == [0])
            patience[0] = 60 if wakes else BRIEF
            monkeypatch.setattr(module, "CONNECT", 1.0)
            said.clear()
            empty.scheduler.send_signal(signal.SIGSTOP)
            return list(executor.results())

    try:
        if wakes:
            assert [outcome.state for _, outcome in all_of_it()] == ["done"]
        else:
            with pytest.raises(ClusterError, match="no answer of the scheduler"):
                all_of_it()
    finally:
        empty.scheduler.send_signal(signal.SIGCONT)
    assert len(said) == 1


# ------------------------------------------------------------------ killed in the middle of a run
class After(Quiet):
    """Does something once, when the first parts are back."""

    def __init__(self, do: Callable[[], Any]) -> None:
        self.do, self.count = do, 0

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        self.count += outcome.state == "done"
        if self.count == 3:
            self.do()


@pytest.fixture(scope="module")
def expected(clip: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    root = tmp_path_factory.mktemp("expected")
    segment(clip, root)
    return masks(root / "out" / "disc")


@pytest.mark.parametrize("who", ["workers", "scheduler"])
def test_a_run_whose_cluster_is_killed_says_so_and_a_second_run_goes_on(
    who: str,
    clip: Path,
    tmp_path: Path,
    expected: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
    patience: list[float],
) -> None:
    monkeypatch.setattr(driving, "TINY", 0.0)  # a task a part
    settings = resolve(overrides={"chunk.length": 4})

    def go(made: Cluster, watcher: After) -> Report:
        out, store = tmp_path / "out", tmp_path / "store"
        return run(Request([str(clip)], out, store, settings, str(made.file)), watcher)

    with cluster(tmp_path / who) as made:

        def harm() -> None:
            patience[0] = BRIEF
            made.kill_workers() if who == "workers" else kill(made.scheduler)

        report = go(made, After(harm))
    patience[0] = 60.0
    assert report.failures["disc"].startswith("not finished: ")
    assert "run the same command again" in report.failures["disc"]
    record = json.loads((tmp_path / "store" / "runs" / f"{report.run}.json").read_text())
    assert record["outcome"] == "failed"
    (tmp_path / who / "scheduler.json").unlink(missing_ok=True)
    with cluster(tmp_path / who) as made:
        second = After(lambda: None)
        assert go(made, second).finished == ["disc"]
    stages = len(second_plan(tmp_path, clip))
    assert 0 < second.count <= stages - 3
    np.testing.assert_array_equal(masks(tmp_path / "out" / "disc"), expected)


def second_plan(root: Path, clip: Path) -> list[str]:
    """All parts that a run of nothing would do."""
    _, counter = segment(clip, root / "whole")
    return [f"{stage} {part}" for stage, part in counter.parts]


# ------------------------------------------------------------------ our own cluster
def test_a_worker_that_dies_while_the_local_cluster_starts_ends_in_a_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import dask

    with (
        dask.config.set({"distributed.worker.preload": ["import os; os._exit(3)"]}),
        pytest.raises(ClusterError, match="the local cluster did not start"),
        Dask("local", 1),
    ):
        raise AssertionError("it started")


@pytest.mark.usefixtures("pretending")
def test_workers_of_ours_that_are_gone_for_good_are_started_again(tmp_path: Path) -> None:
    with Dask("local", 1, patience=60) as executor:
        executor.submit(job(0, tmp_path / "log", 0.2), [], 0)
        executor._cluster.scale(0)
        until(lambda: not executor._present())
        executor.submit(job(1, tmp_path / "log"), [], 0)
        outcomes = dict(executor.results())
    assert [outcome.state for outcome in outcomes.values()] == ["done", "done"]


def test_workers_of_ours_start_with_the_allocator_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)  # Dask leaves it there
    monkeypatch.setenv("MALLOC_MMAP_THRESHOLD_", "12345678")
    with Dask("local", 1) as executor:
        (found,) = executor._client.run(lambda: dict(os.environ)).values()
    assert found["MALLOC_TRIM_THRESHOLD_"] == str(local_cluster.ALLOCATOR["MALLOC_TRIM_THRESHOLD_"])
    assert found["MALLOC_MMAP_THRESHOLD_"] == "12345678", "what the user sets wins"
    assert found["OMP_NUM_THREADS"] == "1"


# ------------------------------------------------------------------ workers that cannot do the work
@pytest.mark.parametrize(
    ("package", "problem"),
    [
        ('__version__ = "0.0.1"', "has zsmoseg 0.0.1, this is"),
        ('raise ImportError("no numba here")', "cannot load zsmoseg"),
        (
            f"__version__ = {__version__!r}\nimport sys\nsys.modules['zsmoseg.workflows'] = None",
            "has another zsmoseg",
        ),
    ],
)
def test_a_worker_with_another_package_is_named_before_work_starts(
    package: str,
    problem: str,
    clip: Path,
    empty: Cluster,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "other" / "zsmoseg").mkdir(parents=True)
    (tmp_path / "other" / "zsmoseg" / "__init__.py").write_text(package)
    empty.worker("--name", "odd", first=[tmp_path / "other"])
    code = main(["run", str(clip), "-o", str(tmp_path / "out"), "--scheduler", str(empty.file)])
    err = capsys.readouterr().err
    (line,) = [x for x in err.splitlines() if x.startswith("zsmoseg:")] or [err]
    assert code == 2
    assert "1 of 1 workers cannot do this work: odd (tcp://127.0.0.1:" in line
    assert problem in line
    assert not list((tmp_path / "out").rglob("*.png"))


def needs(root: Path) -> Needs:
    for name in ("store", "out"):
        (root / name).mkdir()
    (root / "store" / "record.json").write_text("{}")
    (root / "a.mp4").write_bytes(b"x")
    return Needs.of(
        root / "store", root / "store" / "record.json", [str(root / "a.mp4")], [str(root / "out")]
    )


def test_a_worker_that_sees_all_has_no_problem_and_leaves_nothing(tmp_path: Path) -> None:
    wanted = needs(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert look(wanted) is None
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("gone", "problem"),
    [
        ("store/record.json", "does not see the store"),
        ("a.mp4", "cannot read the source"),
        ("out", "cannot write in"),
    ],
)
def test_what_a_worker_does_not_see_is_named(
    gone: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zsmoseg.workflows.running.workers.LATE", 1)
    wanted = needs(tmp_path)
    (tmp_path / gone).rename(tmp_path / "elsewhere")
    found = look(wanted)
    assert found is not None
    assert problem in found
    assert gone.split("/")[0] in found


@pytest.mark.usefixtures("pretending")
def test_a_worker_that_comes_later_is_looked_at_too(
    empty: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOOK", 0.1)
    empty.worker()
    (tmp_path / "other" / "zsmoseg").mkdir(parents=True)
    (tmp_path / "other" / "zsmoseg" / "__init__.py").write_text('__version__ = "0.0.1"')

    def all_of_it() -> None:
        with Dask(str(empty.file), needs=needs(tmp_path)) as executor:
            for part in range(60):
                executor.submit(job(part, tmp_path / "log", 0.3), [], -part)
            empty.worker("--name", "late", first=[tmp_path / "other"])
            list(executor.results())

    with pytest.raises(
        ClusterError, match=r"1 of 2 workers cannot do this work: late .* has zsmoseg 0\.0\.1"
    ):
        all_of_it()


def test_of_many_sources_a_sample_is_looked_at(tmp_path: Path) -> None:
    assert len(Needs.of(tmp_path, tmp_path, [str(n) for n in range(10_000)], []).sources) <= 64


# ------------------------------------------------------------------ which cluster
def test_the_address_in_the_environment_is_the_default_and_the_option_wins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def chosen(*words: str) -> str:
        parser = argparse.ArgumentParser()
        execution_options(parser)
        return str(parser.parse_args(words).scheduler)

    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    assert chosen() == "local"
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://there:8786")
    assert chosen() == "tcp://there:8786"
    assert chosen("--scheduler", "serial") == "serial"


def test_nobody_answers_at_an_address(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "CONNECT", 1.0)
    where = ["--scheduler", "tcp://127.0.0.1:9"]
    assert main(["run", str(clip), "-o", str(tmp_path / "out"), *where]) == 2
    assert "no Dask scheduler answers there" in capsys.readouterr().err


def test_a_scheduler_file_that_never_comes(tmp_path: Path) -> None:
    with pytest.raises(ClusterError, match="no scheduler file"), Dask(str(tmp_path / "s.json"), patience=1):
        raise AssertionError("it started")


@contextmanager
def taken_port(kind: str, cluster: Cluster) -> Iterator[str]:
    """The address of somebody who takes connections and is no scheduler that answers."""
    with ExitStack() as stack:
        if kind == "stopped":
            cluster.scheduler.send_signal(signal.SIGSTOP)
            stack.callback(cluster.scheduler.send_signal, signal.SIGCONT)
            yield str(cluster.file)
        elif kind == "silent":
            yield f"tcp://127.0.0.1:{stack.enter_context(socket.create_server(('127.0.0.1', 0))).getsockname()[1]}"
        else:
            made = stack.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler))
            Thread(target=made.serve_forever, args=(0.05,), daemon=True).start()
            stack.callback(made.shutdown)
            yield f"{'tcp://' if kind == 'web' else ''}127.0.0.1:{made.server_port}"


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("stopped", "look whether it is stopped"),
        ("silent", "not that of its dashboard or of another program"),
        ("web", "a web server answers there"),
        ("web without scheme", "a web server answers there"),
    ],
)
def test_who_takes_the_connection_and_says_nothing_is_given_up_by_name(
    kind: str, says: str, idle: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "CONNECT", 1.0)
    monkeypatch.setattr(scheduler, "TICK", 0.5)
    monkeypatch.setattr(BaseHTTPRequestHandler, "log_message", lambda *_: None)
    with taken_port(kind, idle) as address:
        with pytest.raises(ClusterError, match=says) as error, Dask(address, patience=0.2):
            raise AssertionError("it started")
        assert address in str(error.value)


def test_a_scheduler_that_wakes_is_waited_for_with_a_word(
    idle: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "CONNECT", 1.0)
    said: list[str] = []

    def wake(begun: float, what: str, cure: str) -> None:
        said.append(what)
        idle.scheduler.send_signal(signal.SIGCONT)
        monkeypatch.setattr(scheduler, "CONNECT", 10.0)

    with taken_port("stopped", idle) as file:
        client = scheduler.connect(file, 60, wake)
    assert client.status == "running"
    client.close()
    assert said[0] == f"answer of the scheduler {idle.file}"


@pytest.mark.parametrize(
    ("where", "says"),
    [
        ("nonsense", "missing port number"),
        ("", "missing port number"),
        ("http://127.0.0.1:80", "unknown address scheme 'http'"),
        ("tcp://[::1", "invalid address"),
        ("tcp://::1:80", "ipv6 needs brackets"),
        ("tcp://127.0.0.1:99999", "ports are 1 to 65535"),
        ("tcp://127.0.0.1:0", "ports are 1 to 65535"),
        ("tcp://127.0.0.1:many", "invalid literal"),
        ("tcp://:8786", "no host"),
        (5, "is of type int"),
        (b"tcp://127.0.0.1:1", "is of type bytes"),
        (Path("scheduler.json"), "all as text"),
        (None, "is of type NoneType"),
    ],
)
@pytest.mark.parametrize("dry", [False, True])
def test_what_is_no_scheduler_is_told_before_anything_is_looked_at(
    where: Any, says: str, dry: bool, tmp_path: Path
) -> None:
    request = Request(["no such video"], tmp_path / "out", tmp_path / "store", scheduler=where)
    with pytest.raises(SettingsError, match=re.escape(says)) as error:
        list(dry_run(request)) if dry else run(request)
    assert isinstance(where, str) is (f"--scheduler {where!r}" in str(error.value))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "address",
    [
        "tcp://there:8786",
        "there:8786",
        "[::1]:8786",
        "tls://[::1]:8786",
        "ws://there:80",
        "inproc://there/1/2",
    ],
)
def test_every_address_of_dask_may_be_one(address: str) -> None:
    scheduler.check_scheduler(address)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b'{"address": 5}', "its address is 5"),
        (b'{"x": 1}', "it holds no address"),
        (b"[1]", "it holds no address"),
        (b'"tcp://127.0.0.1:1"', "it holds no address"),
        (b"", "it is empty"),
        (b"\n", "it is empty"),
        (b"garbage", "Expecting value"),
        (b"\xff\xfe\xfd", "decode"),
        (b'{"a":' + b"[" * 200_000, "nested too deep"),
        (b'{"address": "nonsense"}', "missing port number"),
        (b" " * 2000, "larger than"),
        ("folder", "a folder"),
        ("pipe", "a pipe or a device"),
    ],
)
def test_a_bad_scheduler_file_is_named(
    content: bytes | str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "SETTLING", 0.1)
    monkeypatch.setattr(scheduler, "LARGEST", 1000 if content == b" " * 2000 else scheduler.LARGEST)
    file = tmp_path / "scheduler.json"
    if isinstance(content, bytes):
        file.write_bytes(content)
    else:
        file.mkdir() if content == "folder" else os.mkfifo(file)
    with pytest.raises(SettingsError, match=re.escape(says)) as error:
        scheduler.check_scheduler(str(file))
    assert f"--scheduler {file}: is no scheduler file" in str(error.value)


def test_a_scheduler_file_that_is_being_written_is_waited_for(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text('{"address":')
    timer = Timer(0.3, file.write_text, ['{"address": "tcp://127.0.0.1:1"}'])
    timer.start()
    assert scheduler.scheduler_address(str(file)) == "tcp://127.0.0.1:1"
    timer.join()


# ------------------------------------------------------------------ the docs
SRUN = """#!/bin/sh
"$@" --host 127.0.0.1 & first=$!
"$@" --host 127.0.0.1 & second=$!
trap 'kill $first $second' TERM
wait
"""
"""Two tasks on this machine."""


def test_the_slurm_script_in_the_docs_runs(clip: Path, tmp_path: Path) -> None:
    docs = (ROOT / "docs" / "cluster.md").read_text()
    script = docs.split("<!-- tests/test_cluster.py")[1].split("```bash\n")[1].split("```")[0]
    zsmoseg = f'#!/bin/sh\nexec {sys.executable} -c "from zsmoseg.workflows.cli import main as m; raise SystemExit(m())" "$@"\n'
    dask = f'#!/bin/sh\nexec {sys.executable} -m dask "$@"\n'
    for name, text in (("srun", SRUN), ("zsmoseg", zsmoseg), ("dask", dask), ("job.sh", script)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    given = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SLURM_JOB_ID": "7",
        "ZSMOSEG_DATA": str(clip),
        "ZSMOSEG_OUT": str(tmp_path / "out"),
        "ZSMOSEG_STORE": str(tmp_path / "store"),
    }
    found = subprocess.run(
        ["bash", "job.sh"], cwd=tmp_path, env=os.environ | given, capture_output=True, text=True, timeout=120
    )
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "out" / "disc" / "summary.json").exists()
    kinds = [json.loads(line)["event"] for line in (tmp_path / "events-7.jsonl").read_text().splitlines()]
    assert kinds[0] == "planned"
    assert kinds[-2:] == ["finished", "ended"]
    assert not (tmp_path / "scheduler-7.json").exists()


def test_the_local_cluster_and_its_dashboard_listen_on_this_machine_only() -> None:
    import psutil

    from zsmoseg.workflows.running.local_cluster import start

    def listening() -> set[Any]:
        ours = psutil.Process()
        return {
            connection.laddr
            for process in (ours, *ours.children(recursive=True))
            for connection in process.net_connections("tcp")
            if connection.status == psutil.CONN_LISTEN
        }

    before = listening()
    with ExitStack() as stack:
        stack.enter_context(start(1, stack))
        places = listening() - before
    assert {place.ip for place in places} == {"127.0.0.1"}


@pytest.mark.usefixtures("pretending")
def test_a_task_that_runs_over_gets_another_worker_and_fails_the_second_time(tmp_path: Path) -> None:
    said: list[str] = []
    with Dask("local", 1, say=said.append) as executor:
        executor.submit(replace(job(0, tmp_path / "log", 300), deadline=0.5), [], 0)
        executor.submit(job(1, tmp_path / "log"), [], -1)
        outcomes = {name[-4:]: outcome for name, outcome in executor.results()}
    assert outcomes["0001"].state == "done", "others go on"
    assert outcomes["0000"].state == "failed"
    assert re.search(r"runs since \d+ s on tcp://127.*it had 0 s, 2 times; look at", outcomes["0000"].error)
    assert len([line for line in said if "its worker is started anew" in line]) == 2
    assert len(tries(tmp_path / "log")) == 3


def test_a_deadline_follows_the_estimate_and_leaves_room() -> None:
    assert deadlines.deadline(0.1) == deadlines.LEAST
    assert deadlines.deadline(3600.0) == 3600.0 * deadlines.TIMES
