"""What the allocator's thresholds do for local workers: seconds, page faults, memory, with Dask's value and with ours.

python benchmarks/allocator.py shared/data/DAVIS/JPEGImages/480p/goat --frames 24 --workers 2 --rounds 2
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from zsmoseg.settings import resolve
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running import local_cluster
from zsmoseg.workflows.running import run as running
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet, Request

OURS = dict(local_cluster.ALLOCATOR)
CHOICES = {"Dask's": {}, "ours": OURS}


class Peak(Quiet):
    """The largest worker."""

    memory = 0.0

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Keep the largest."""
        self.memory = max(self.memory, outcome.memory_mb)


def measure(choice: str, source: str, frames: int, workers: int) -> tuple[float, float, float, float, float]:
    """Wall seconds, user and system seconds of the workers, millions of page faults, MB of the largest worker.

    In a process of its own: Dask leaves what it sets for workers in the environment of who starts them.
    """
    running.SMALL = 0.0
    local_cluster.ALLOCATOR.clear()
    local_cluster.ALLOCATOR.update(CHOICES[choice])
    settings = resolve(overrides={"video.end": f"{frames}f", "chunk.length": max(4, frames // 4)})
    before, clock, peak = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic(), Peak()
    with tempfile.TemporaryDirectory() as root:
        request = Request([source], Path(root, "out"), Path(root, "store"), settings, "local", workers)
        report = running.run(request, peak)
    assert not report.failures, report.failures
    wall, after = time.monotonic() - clock, resource.getrusage(resource.RUSAGE_CHILDREN)
    return (
        wall,
        after.ru_utime - before.ru_utime,
        after.ru_stime - before.ru_stime,
        (after.ru_minflt - before.ru_minflt) / 1e6,
        peak.memory,
    )


def main() -> None:
    """Alternate between the two, so that what else the machine does hits both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    print(f"{'thresholds':<10} {'wall s':>7} {'user s':>7} {'system s':>8} {'M faults':>8} {'peak MB':>8}")
    for choice in given.rounds * [*CHOICES]:
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            found = alone.submit(measure, choice, given.source, given.frames, given.workers).result()
        wall, user, system, faults, memory = found
        print(f"{choice:<10} {wall:7.1f} {user:7.1f} {system:8.1f} {faults:8.2f} {memory:8.0f}", flush=True)


if __name__ == "__main__":
    main()
