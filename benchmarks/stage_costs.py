"""What each stage costs: processor ms and kB a frame, one core, scaled to 480 x 854.

    python benchmarks/stage_costs.py SOURCE...

The figures of a quiet machine are the ``cost`` of the stages' entries, which serve the first estimate. The first
source is run once before, so that nothing is compiled while the clock runs.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from zsmoseg.settings import resolve
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.planning.rates import DISPLAYED
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.progress import Tally
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run


class Count(Quiet):
    """Adds up what comes back."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.plans: list[VideoPlan] = []
        self.summaries: list[dict[str, Any]] = []

    def planned(self, plan: VideoPlan) -> None:
        """One video."""
        self.plans.append(plan)

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """What came out of it."""
        self.summaries += [summary] if summary else []

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part."""
        self.tally.add(plan, stage, part, outcome)


def measure(sources: list[str], settings: dict[str, object]) -> tuple[Count, Tally, float]:
    """One run in an empty store: its videos, the stages' seconds, processor seconds in all."""
    with tempfile.TemporaryDirectory() as folder:
        root, count, begun = Path(folder), Count(), time.process_time()
        request = Request(sources, root / "out", root / "store", resolve(overrides=settings), "serial")
        run(request, count)
        return count, count.tally, time.process_time() - begun


def main() -> None:
    """Print the table."""
    measure(sys.argv[1:2], {"video.end": "20f"})
    count, tally, seconds = measure(sys.argv[1:], {})
    pixels = sum(len(p.probe.times) * p.probe.width * p.probe.height for p in count.plans) / DISPLAYED
    print(f"{'stage':<11} {'ms/frame':>9} {'kB/frame':>9} {'peak MB':>8}")
    size = 0.0
    for stage, spent, _, memory in tally.rows():
        kilobytes = sum(s["stages"].get(stage, {}).get("megabytes", 0.0) for s in count.summaries) * 1e3
        size += kilobytes
        print(f"{stage:<11} {1e3 * spent / pixels:9.1f} {kilobytes / pixels:9.1f} {memory:8.0f}")
    staged = sum(tally.seconds.values())
    print(f"{'stages':<11} {1e3 * staged / pixels:9.1f} {size / pixels:9.1f}")
    print(f"{'all':<11} {1e3 * seconds / pixels:9.1f}   planning, records and summaries included")


if __name__ == "__main__":
    main()
