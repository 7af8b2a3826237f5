"""What a run says while it runs: rich bars on a terminal, plain lines elsewhere; the summary at its end."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Mapping
from threading import Event, Thread
from types import TracebackType
from typing import Any, Self, TextIO

from zsmoseg.workflows.imports.told import brought_lines
from zsmoseg.workflows.planning.estimate import Estimate, estimate_lines
from zsmoseg.workflows.planning.plan import VideoPlan, explain_plan
from zsmoseg.workflows.planning.rates import Rates
from zsmoseg.workflows.running.course import Course
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet
from zsmoseg.workflows.wording import counted

SHOWN = 6
"""Videos whose plan is printed in full before a run, and names in a row of a table."""
NAMES = 40
"""Letters of the column of names."""
EVERY = 8.0
"""Seconds after which plain lines say how far a run is."""
TICK = 1.0
"""Seconds from one look at the clock to the next."""
LEAVING = 1.0
"""Seconds that the last line is waited for."""


class Tally:
    """Seconds, frames and peak memory of every stage, as they come back."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.frames: dict[str, int] = defaultdict(int)
        self.memory: dict[str, float] = defaultdict(float)
        self.warm_up = 0.0

    def add(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Count one part."""
        if outcome.state != "done":
            return
        start, stop = plan.stages[stage].parts[part]
        self.frames[stage] += stop - start
        self.seconds[stage] += outcome.seconds
        self.warm_up += outcome.warm_up
        self.memory[stage] = max(self.memory[stage], outcome.memory_mb)

    def rows(self) -> list[tuple[str, float, float, float]]:
        """(stage, seconds, ms a frame, peak MB)."""
        return [
            (s, self.seconds[s], 1e3 * self.seconds[s] / max(self.frames[s], 1), self.memory[s])
            for s in self.seconds
        ]


class Lines:
    """Plain lines for logs and pipes: the plan, a line a stage, a line a video."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self.stream = stream or sys.stderr
        self.tally = Tally()
        self.course = Course(Rates.load())
        self.begun = self._told = time.monotonic()
        self._notes: set[str] = set()
        self._over, self._teller = Event(), Thread(target=self.keep_telling, daemon=True)

    def say(self, line: str = "") -> None:
        """Print one line."""
        print(line, file=self.stream, flush=True)

    def planned(self, plan: VideoPlan) -> None:
        """The plans of the first few videos."""
        self.course.plan(plan)
        for line in explain_plan([plan]) if self.course.planned <= SHOWN else self._new_notes(plan):
            self.say(line)
        self._notes.update(plan.notes)

    def _new_notes(self, plan: VideoPlan) -> list[str]:
        """What is to be known of a video, and was not said of another."""
        return [f"{plan.name}: {note}" for note in plan.notes if note not in self._notes]

    def estimated(self, guess: Estimate) -> None:
        """What all will take."""
        self.course.estimated(guess)
        for line in first_lines(guess):
            self.say(line)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """A line when a stage is through."""
        self.count(plan, stage, part, outcome)
        if not plan.stages[stage].todo and outcome.state == "done":
            self.say(f"{plan.name}: {stage} done ({time.monotonic() - self.begun:.0f} s)")

    def count(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Keep what a part took."""
        self.tally.add(plan, stage, part, outcome)
        self.course.part(plan, stage, part)

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """A line a video, and how far the batch is."""
        self.course.finish(plan)
        for line in video_lines(plan, summary):
            self.say(line)
        self.stands()

    def failed(self, name: str, message: str) -> None:
        """A line a failure."""
        self.course.fail(name)
        self.say(f"failed: {name}: {message}")
        self.stands()

    def stands(self) -> None:
        """How far the batch is."""
        if self.course.many:
            self.tell()

    def tell(self) -> None:
        """Say how far it is, now."""
        self._told = time.monotonic()
        self.say(self.course.words())

    def keep_telling(self) -> None:
        """Say so again and again, on a thread of its own: a task may take minutes."""
        while not self._over.wait(TICK):
            if self.course.videos and time.monotonic() - self._told >= EVERY:
                try:
                    self.tell()
                except (OSError, ValueError):  # nobody reads any more: the run finds out by itself
                    return

    def note(self, text: str) -> None:
        """A line about the run as a whole."""
        self.say(text)

    def __enter__(self) -> Self:
        self._teller.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        if self._teller.is_alive():
            self._teller.join(LEAVING)  # no longer: a pipe that nobody reads would hold it
        if kind is None and self.tally.seconds:
            for line in tally_lines(self.tally, time.monotonic() - self.begun):
                self.say(line)


class Bars(Lines):
    """A bar a video in flight, above it what is finished."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        super().__init__()
        self.console = Console(stderr=True, highlight=False)
        self.progress = Progress(
            TextColumn("{task.description:<24}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[stage]:<11}"),
            TimeRemainingColumn(),
            console=self.console,
            transient=True,
        )
        self.bars: dict[str, Any] = {}
        self.all: Any = None

    def say(self, line: str = "") -> None:
        """Print one line above the bars."""
        self.console.print(line, markup=False, soft_wrap=True)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Move the bar of the video, and that of the batch."""
        self.count(plan, stage, part, outcome)
        if plan.name not in self.bars:
            self.bars[plan.name] = self.progress.add_task(plan.name, total=plan.todo + 1, stage=stage)
        self.progress.update(self.bars[plan.name], advance=1, stage=stage)
        self.stands()

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """Take the bar away, leave the line."""
        self._remove(plan.name)
        super().finished(plan, summary)

    def failed(self, name: str, message: str) -> None:
        """Take the bar away, leave the line."""
        self._remove(name)
        super().failed(name, message)

    def _remove(self, name: str) -> None:
        bar = self.bars.pop(name, None)
        if bar is not None:
            self.progress.remove_task(bar)

    def stands(self) -> None:
        """The uppermost bar is that of the batch."""
        if self.course.many:
            if self.all is None:
                self.all = self.progress.add_task("", total=1, stage="")
            words = self.course.words().partition(" frames")[0]
            self.progress.update(self.all, description=f"{words} frames", completed=self.course.share)

    def keep_telling(self) -> None:
        """The bars do."""

    def __enter__(self) -> Self:
        self.progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.progress.stop()
        super().__exit__(kind, error, trace)


class Steps(Quiet):
    """For runs within another job: a line a run, and what failed."""

    def estimated(self, guess: Estimate) -> None:
        """What is to do."""
        what = "; ".join(estimate_lines(guess))
        print(f"{counted(guess.videos, 'video')}: {what}", file=sys.stderr, flush=True)

    def failed(self, name: str, message: str) -> None:
        """A line a failure."""
        print(f"failed: {name}: {message}", file=sys.stderr, flush=True)

    def note(self, text: str) -> None:
        """A line about the run as a whole."""
        print(text, file=sys.stderr, flush=True)


def make_watcher() -> Lines:
    """Bars where somebody looks, lines elsewhere."""
    return Bars() if sys.stderr.isatty() else Lines()


def failure_lines(failures: Mapping[str, str], videos: int, again: str) -> list[str]:
    """The table of failures, videos with the same one in one row, and the command that goes on from there."""
    if not failures:
        return []
    by_message: dict[str, list[str]] = {}
    for name, message in failures.items():
        by_message.setdefault(message, []).append(name)
    rows = []
    for message, names in by_message.items():
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        rows.append((", ".join(names[:SHOWN]) + more, message))
    width = min(max(len(names) for names, _ in rows), NAMES)
    return [
        f"zsmoseg: {len(failures)} of {counted(videos, 'video')} failed; what was finished is kept",
        *(f"  {names:<{width}}  {message}" for names, message in rows),
        f"  again: {again}",
    ]


def first_lines(guess: Estimate) -> list[str]:
    """How many videos were not shown, and the estimate."""
    more = (
        [f"... and {guess.videos - SHOWN} more videos (all with --dry-run)"] if guess.videos > SHOWN else []
    )
    return [*more, *estimate_lines(guess)]


def video_lines(plan: VideoPlan, summary: dict[str, Any] | None) -> list[str]:
    """What came out of a video."""
    if summary is None:
        return [f"{plan.name}: {counted(len(plan.probe.times), 'frame')}, done up to {list(plan.stages)[-1]}"]
    lines = [
        f"{plan.name}: {counted(summary['frames'], 'frame')}, {counted(summary['objects'], 'object')}, "
        f"{counted(summary['moving_groups'], 'moving group')}, {summary['moving_pixels_percent']:.1f} % of the pixels move"
    ]
    lines += [f"  {line}" for line in (brought_lines(plan) if plan.settled is None else [])]
    lines += [f"  warning: {text}" for text in summary["warnings"]]
    return [*lines, f"  masks: {plan.output.path / 'masks'}"]


def tally_lines(tally: Tally, wall: float) -> list[str]:
    """Seconds of the processor and memory per stage; those of the clock in all."""
    lines = [f"{'stage':<11} {'cpu s':>8} {'ms/frame':>9} {'peak MB':>8}"]
    lines += [f"{s:<11} {sec:>8.2f} {ms:>9.1f} {mb:>8.0f}" for s, sec, ms, mb in tally.rows()]
    if tally.warm_up >= 0.01:
        lines.append(
            f"{'start-up':<11} {tally.warm_up:>8.2f}   compiling, loading what was, opening networks"
        )
    total = sum(tally.seconds.values()) + tally.warm_up
    return [*lines, f"{'all':<11} {total:>8.2f}   of processor time, in {wall:.1f} s by the clock"]
