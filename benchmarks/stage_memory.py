"""What a task of each stage takes in memory beyond what its process had: MB, and bytes a pixel of the frames it holds.

    python benchmarks/stage_memory.py SOURCE [SETTING=VALUE ...]

The figures are the ``memory`` of the stages' entries, from which a plan says what a worker takes. The source is run
twice, so that nothing is compiled or loaded in what is measured. Linux only.
"""

from __future__ import annotations

import ctypes
import gc
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from zsmoseg.settings import Settings, resolve
from zsmoseg.workflows.planning.estimate import task_memory
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running import executors
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.stage import working_size


def resident(peak: bool = False) -> float:
    """MB of this process now, or at most since ``forget_peak``."""
    name = "VmHWM" if peak else "VmRSS"
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(name)).split()[1]) / 1024


def forget_peak() -> None:
    """Give back what is free, and begin anew."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")


class Seen(Quiet):
    """Keeps the plans."""

    def __init__(self) -> None:
        self.plans: list[VideoPlan] = []

    def planned(self, plan: VideoPlan) -> None:
        """One video."""
        self.plans.append(plan)


def measure(source: str, settings: Settings) -> tuple[VideoPlan, dict[str, float]]:
    """The plan of a run in an empty store, and the most that a task of each stage took beyond what was there, MB."""
    found: dict[str, float] = defaultdict(float)

    def measured(job: Job, *before: Outcome) -> Outcome:
        forget_peak()
        now = resident()
        outcome = run_job(job, *before)
        assert outcome.state == "done", outcome
        found[job.stage] = max(found[job.stage], resident(peak=True) - now)
        return outcome

    executors.run_job = measured  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        seen = Seen()
        run(Request([source], root / "out", root / "store", settings, "serial"), seen)
        (plan,) = seen.plans
        return plan, found


def main() -> None:
    """Print the table."""
    settings = resolve(overrides=dict(pair.split("=", 1) for pair in sys.argv[2:]))
    measure(sys.argv[1], settings)
    base = resident()
    plan, found = measure(sys.argv[1], settings)
    height, width = working_size(plan.probe, settings.frames.width)
    shown, small = plan.probe.height * plan.probe.width, height * width
    print(f"{'stage':<12} {'MB':>7} {'declared':>8} {'frames':>7} {'B/px shown':>11} {'B/px working':>13}")
    for name, peak in found.items():
        frames = max(b - a for a, b in plan.stages[name].parts)
        declared = task_memory(plan, plan.stages[name]) / 2**20
        print(
            f"{name:<12} {peak:7.1f} {declared:8.1f} {frames:7} {peak * 2**20 / frames / shown:11.2f} {peak * 2**20 / frames / small:13.2f}"
        )
    print(f"a process that has run it takes {base:.0f} MB")


if __name__ == "__main__":
    main()
