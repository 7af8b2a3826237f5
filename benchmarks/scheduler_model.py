"""At how many workers the scheduler is at its limit: what a task costs it, measured, and what follows for the default chunk.

    python benchmarks/scheduler_model.py [--workers 8 64 150] [--videos 40] [--chunks 4] [--rate 80]

The product's executor submits the jobs of videos as a run does (names, priorities, dependencies of the real graph, real
settings, as many videos in flight as keep all workers busy) to a scheduler in a process of its own. Workers of one thread each share another process,
and their tasks sleep: what is measured is the scheduler, not the machine. Processor time of the scheduler a task, and a second when nothing
happens (a share that is always there, and one of each heartbeat; they come less often the more workers there are), give its load:

    load(W) = W / seconds of a task x cost of a task + idle(W)

It is saturated where that is 1; the client where its own cost of a task x W / seconds of a task is. ``expected`` is the load by the cost of
a task in the first row: the model is good as far as ``scheduler``, which is measured, agrees with it.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
from batches import python

from zsmoseg.settings import Settings
from zsmoseg.workflows.running import cluster
from zsmoseg.workflows.running.jobs import Job, Outcome
from zsmoseg.workflows.running.run import IN_FLIGHT
from zsmoseg.workflows.stage import ALL
from zsmoseg.workflows.stages.graph import GRAPHS

GRAPH = "embedded-flow"
IDLE = 5.0
"""Seconds in which nothing happens."""
WARM = 4
"""Videos before the clock runs."""
HOST = "import sys, scheduler_model; scheduler_model.host(sys.argv[1], int(sys.argv[2]))"


def host(file: str, workers: int) -> None:
    """A process of many workers, for ever."""
    from distributed import Worker

    async def all_of_them() -> None:
        places = [tempfile.mkdtemp() for _ in range(1)]
        made = [
            Worker(scheduler_file=file, nthreads=1, local_directory=places[0], dashboard=False)
            for _ in range(workers)
        ]
        await asyncio.gather(*made)
        await asyncio.gather(*(worker.finished() for worker in made))

    asyncio.run(all_of_them())


def sleeping(job: Job, *before: Outcome) -> Outcome:
    """In the place of ``run_job``."""
    time.sleep(float(job.out))
    return Outcome("done", 0.1, 300.0)


def video_jobs(video: int, chunks: int, seconds: float) -> Iterator[tuple[Job, list[str], int]]:
    """The jobs of a video of the default graph, as ``run.jobs`` gives them."""
    graph, settings = GRAPHS[GRAPH], Settings()
    count = {name: 1 if stage.scope == "video" else chunks for name, stage in graph.items()}
    named: dict[tuple[str, int], str] = {}
    for place, (name, stage) in enumerate(graph.items()):
        dumped = {s: getattr(settings, s).model_dump(mode="json") for s in stage.section_names}
        keys = {read: f"{read:0<20}" for read in stage.reaches}
        for part in range(count[name]):
            job = Job("/store", f"video{video:05d}", name, "k" * 20, part, 32 * part, 32 * part + 32, "f" * 20, dumped, keys, str(seconds))  # fmt: skip
            named[name, part] = job.name
            before = [
                named[read, other]
                for read, reach in stage.reaches.items()
                for other in range(count[read])
                if reach == ALL or count[name] == 1 or count[read] == 1 or part <= other <= part + bool(reach)
            ]
            yield job, before, place - len(graph) * video


def drive(executor: cluster.Dask, videos: range, chunks: int, seconds: float) -> int:
    """As ``run`` does: a window of videos; the number of tasks."""
    left: dict[str, set[str]] = {}
    waiting, tasks = iter(videos), 0

    def more() -> None:
        video = next(waiting, None)
        for job, before, priority in () if video is None else video_jobs(video, chunks, seconds):
            left.setdefault(job.video, set()).add(job.name)
            of[job.name] = job.video
            executor.submit(job, before, priority)

    of: dict[str, str] = {}
    done: dict[str, list[str]] = {}
    for _ in range(max(IN_FLIGHT, 2 * len(executor._present() or ()) // chunks)):
        more()
    for name, outcome in executor.results():
        assert outcome.state == "done", outcome.error
        tasks, video = tasks + 1, of.pop(name)
        left[video].remove(name)
        done.setdefault(video, []).append(name)
        if not left[video]:
            executor.release(done.pop(video))
            more()
    return tasks


@dataclass(frozen=True)
class Measured:
    """Of one number of workers: tasks, and seconds of wall and processor."""

    workers: int
    tasks: int
    wall: float
    scheduler: float
    client: float
    idle: float
    """Of the scheduler, in a second without work."""

    @property
    def cost(self) -> float:
        """Processor seconds of the scheduler a task, without the heartbeats."""
        return (self.scheduler - self.idle * self.wall) / self.tasks


def busy(process: psutil.Process) -> float:
    """Processor seconds so far."""
    times = process.cpu_times()
    return float(times.user + times.system)


def measure(workers: int, videos: int, chunks: int, seconds: float, root: Path) -> Measured:
    """Start all, wait, work, end all."""
    file, told = root / f"{workers}.json", root / "told.txt"
    scheduler = python(["-m", "dask", "scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard",
                        "--scheduler-file", str(file)], told)  # fmt: skip
    while not file.exists():
        time.sleep(0.05)
    hosts = python(["-c", HOST, str(file), str(workers)], told)
    try:
        with cluster.Dask(str(file), patience=120) as executor:
            while len(executor._present() or ()) < workers:
                time.sleep(0.2)
            watched = psutil.Process(scheduler.pid)
            drive(executor, range(WARM), chunks, 0.01)
            before, begun = busy(watched), time.monotonic()
            time.sleep(IDLE)
            idle = (busy(watched) - before) / (time.monotonic() - begun)
            before, mine, begun = busy(watched), time.process_time(), time.monotonic()
            tasks = drive(executor, range(WARM, WARM + videos), chunks, seconds)
            wall, client = time.monotonic() - begun, time.process_time() - mine
            return Measured(workers, tasks, wall, busy(watched) - before, client, idle)
    finally:
        for process in (hosts, scheduler):
            process.kill()
            process.wait()


def default_task() -> float:
    """Seconds of a task of the default chunk at 480p, by the typical figures of the stages."""
    stages, frames = GRAPHS[GRAPH].values(), Settings().chunk.length
    return sum(stage.cost[0] for stage in stages) / 1e3 * frames / len(stages)


def main() -> None:
    """Measure and say what follows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, nargs="+", default=[8, 64, 150])
    parser.add_argument("--videos", type=int, default=40)
    parser.add_argument("--chunks", type=int, default=4)
    parser.add_argument(
        "--rate", type=float, default=80.0, help="tasks a second: a task sleeps workers / rate seconds"
    )
    given = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    import scheduler_model  # by this name workers find what they run

    cluster.run_job = scheduler_model.sleeping  # type: ignore[attr-defined]
    rows: list[Measured] = []
    print("| workers | tasks | tasks/s | scheduler | expected | scheduler ms/task | client ms/task | idle |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as root:
        for workers in given.workers:
            row = measure(workers, given.videos, given.chunks, workers / given.rate, Path(root))
            rows.append(row)
            rate = row.tasks / row.wall
            expected = rate * rows[0].cost + row.idle
            print(
                f"| {workers} | {row.tasks} | {rate:.0f} | {row.scheduler / row.wall:.0%} | {expected:.0%} | "
                f"{1e3 * row.cost:.2f} | {1e3 * row.client / row.tasks:.2f} | {row.idle:.1%} |",
                flush=True,
            )
    conclude(rows)


def conclude(rows: list[Measured]) -> None:
    """Print where scheduler and client are saturated."""
    first, last, task = rows[0], rows[-1], default_task()
    cost = sum(row.cost for row in rows) / len(rows)
    client = sum(row.client / row.tasks for row in rows) / len(rows)
    beat = max(0.0, (last.idle - first.idle) / (beats(last.workers) - beats(first.workers) or 1.0))
    always = max(0.0, last.idle - beat * beats(last.workers))

    def load(workers: float) -> float:
        return workers / task * cost + always + beat * beats(workers)

    full = next(workers for workers in range(1, 10**6) if load(workers) >= 1)
    print(f"a task of the default chunk at 480p: {task:.2f} s; a heartbeat: {1e3 * beat:.2f} ms")
    print(f"the scheduler is saturated at {full} workers, the client at {task / client:.0f}")
    need = 1000 * cost / (1 - always - beat * beats(1000))
    frames = Settings().chunk.length * max(need, 1000 * client) / task
    print(
        f"1,000 workers want tasks of {need:.1f} s (scheduler) and {1000 * client:.1f} s (client): chunks of {frames:.0f} frames"
    )


def beats(workers: float) -> float:
    """Heartbeats a second, as Dask sets them."""
    from distributed.scheduler import heartbeat_interval

    return workers / float(heartbeat_interval(workers))


if __name__ == "__main__":
    main()
