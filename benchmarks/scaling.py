"""What a second worker brings, and what scheduler and store take beside the science.

    python benchmarks/scaling.py DAVIS/JPEGImages/480p/{goat,dog,libby} [--workers 1 2] [--rounds 2] [--set KEY=VALUE]

Every run computes all of the sources from nothing on a local cluster of one-thread workers; the numbers of workers alternate.
``wall`` is the whole command without imports, ``start`` of it what passes until the first part is back: planning, the cluster, imports of
the workers. The efficiency of n workers is (wall of one) / (n x wall of n), also without the start. ``client`` is the processor
time of client and scheduler behind the start.

Then one run without a cluster is looked at every few milliseconds: where its processor time goes, science, store (all that is below
``stores``) or around them (planning and running).
"""

from __future__ import annotations

import argparse
import resource
import signal
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from zsmoseg.settings import parse_override, resolve
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running import run as running
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet, Request

EVERY = 0.005
"""Seconds of processor time from one look to the next."""
ROOMS = {"/stores/": "store", "/stages/": "science"}
"""Who a moment belongs to: the innermost of these folders that is on the stack."""


class Run(NamedTuple):
    """Seconds of one run."""

    wall: float
    start: float
    tasks: float
    client: float
    parts: int


class Seconds(Quiet):
    """Adds up what tasks took."""

    def __init__(self) -> None:
        self.tasks, self.parts, self.first, self.client = 0.0, 0, 0.0, 0.0

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part."""
        if not self.parts:
            self.first, self.client = time.monotonic(), time.process_time()
        self.tasks, self.parts = self.tasks + outcome.seconds, self.parts + 1


def compute(sources: list[str], given: list[str], scheduler: str, workers: int) -> Run:
    """All of the sources in an empty store."""
    running.SMALL = 0.0
    chosen, seconds, begun = resolve(overrides=dict(map(parse_override, given))), Seconds(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        request = Request(sources, Path(folder, "out"), Path(folder, "store"), chosen, scheduler, workers)
        report = running.run(request, seconds)
        end = time.monotonic()
    assert not report.failures, report.failures
    client = time.process_time() - seconds.client
    return Run(end - begun, seconds.first - begun, seconds.tasks, client, seconds.parts)


class Sampler:
    """Whose processor time it is, by looks at the stack: a look stands for the time since the one before."""

    def __init__(self) -> None:
        self.found: Counter[str] = Counter()
        self._last = time.process_time()

    def _look(self, number: int, frame: FrameType | None) -> None:
        now = time.process_time()
        self.found[self._room(frame)] += now - self._last  # type: ignore[assignment]
        self._last = now

    def _room(self, frame: FrameType | None) -> str:
        while frame is not None:
            for folder, room in ROOMS.items():
                if folder in frame.f_code.co_filename:
                    return room
            frame = frame.f_back
        return "around"

    def __enter__(self) -> Sampler:
        signal.signal(signal.SIGPROF, self._look)
        signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)


def shares(sources: list[str], given: list[str]) -> dict[str, float]:
    """Processor seconds of science, store and what is around them, without the imports."""
    compute(sources[:1], [*given, "video.end=8f"], "serial", 1)
    with Sampler() as sampler:
        compute(sources, given, "serial", 1)
    return dict(sampler.found)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--set", action="append", default=[])
    given = parser.parse_args()
    best: dict[int, Run] = {}
    print(f"{'workers':>7} {'wall s':>7} {'start s':>7} {'task s':>7} {'client s':>8} {'ms a task':>9}")
    for workers in given.rounds * given.workers:
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            run = alone.submit(compute, given.sources, given.set, "local", workers).result()
        each = 1e3 * run.client / run.parts
        print(
            f"{workers:7d} {run.wall:7.1f} {run.start:7.1f} {run.tasks:7.1f} {run.client:8.2f} {each:9.2f}",
            flush=True,
        )
        best[workers] = min(run, best.get(workers, run))
    one = best[given.workers[0]]
    for workers, run in best.items():
        efficiency = one.wall * given.workers[0] / (workers * run.wall)
        client = run.client / run.tasks
        print(
            f"{workers} workers: efficiency {efficiency:.2f}; client and scheduler {client:.1%} of task time"
        )
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:
        found = alone.submit(shares, given.sources, given.set).result()
    for room, seconds in sorted(found.items()):
        print(f"{room:>7}: {seconds:6.2f} s, {seconds / found['science']:.1%} of the science")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"largest process {peak:.0f} MB")


if __name__ == "__main__":
    main()
