"""What a run says while it runs: rich bars on a terminal, plain lines elsewhere; the summary at its end."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self, TextIO

from zsmoseg.workflows.imports.told import brought_lines
from zsmoseg.workflows.planning.estimate import Estimate, estimate_line
from zsmoseg.workflows.planning.plan import VideoPlan, explain_plan
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet

SHOWN = 6
"""Videos whose plan is printed in full before a run, and names in a row of a table."""
NAMES = 40
"""Letters of the column of names."""


class Tally:
    """Seconds, frames and peak memory of every stage, as they come back."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.frames: dict[str, int] = defaultdict(int)
        self.memory: dict[str, float] = defaultdict(float)

    def add(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Count one part."""
        if outcome.state != "done":
            return
        start, stop = plan.stages[stage].parts[part]
        self.frames[stage] += stop - start
        self.seconds[stage] += outcome.seconds
        self.memory[stage] = max(self.memory[stage], outcome.memory_mb)

    def rows(self) -> list[tuple[str, float, float, float]]:
        """(stage, seconds, ms a frame, peak MB)."""
        return [
            (s, self.seconds[s], 1e3 * self.seconds[s] / max(self.frames[s], 1), self.memory[s])
            for s in self.seconds
        ]


class Course:
    """How far a batch is: videos, parts, failures, and how long it may still take."""

    def __init__(self) -> None:
        self.begun = time.monotonic()
        self.videos = self.planned = self.finished = self.failed = self.unplanned = 0
        self.parts = self.done = 0

    def plan(self, parts: int) -> None:
        """One more video was planned."""
        self.planned += 1
        self.videos = max(self.videos, self.planned)
        self.parts += parts

    def fail(self, planned: bool) -> None:
        """One more failed, before or after it was planned."""
        self.failed += 1
        self.unplanned += not planned
        self.videos = max(self.videos, self.planned + self.unplanned)

    @property
    def expected(self) -> int:
        """Parts of all videos, going by those that are planned."""
        coming = self.videos - self.planned - self.unplanned
        return self.parts + round(max(coming, 0) * self.parts / max(self.planned, 1))

    @property
    def many(self) -> bool:
        """Whether there is a batch to speak of."""
        return self.videos > 1

    def words(self) -> str:
        """``12 of 90 videos, 1 failed, 480 of 3600 parts, about 2.5 h left``."""
        failed = f", {self.failed} failed" if self.failed else ""
        parts = self.expected
        about = "about " if parts > self.parts else ""
        text = f"{self.finished} of {self.videos} videos{failed}, {self.done} of {about}{parts} parts"
        if not 0 < self.done < parts or self.finished + self.failed == self.videos:
            return text
        left = (time.monotonic() - self.begun) / self.done * (parts - self.done)
        hours, minutes = left / 3600, left / 60
        long = f"{hours:.1f} h" if hours >= 1 else f"{minutes:.0f} min" if minutes >= 1 else f"{left:.0f} s"
        return f"{text}, about {long} left"


class Lines:
    """Plain lines for logs and pipes: the plan, a line a stage, a line a video."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self.stream = stream or sys.stderr
        self.tally = Tally()
        self.course = Course()
        self.names: set[str] = set()
        self.begun = time.monotonic()

    def say(self, line: str = "") -> None:
        """Print one line."""
        print(line, file=self.stream, flush=True)

    def planned(self, plan: VideoPlan) -> None:
        """The plans of the first few videos."""
        self.course.plan(plan.todo)
        self.names.add(plan.name)
        if self.course.planned <= SHOWN:
            for line in explain_plan([plan]):
                self.say(line)

    def estimated(self, guess: Estimate) -> None:
        """What all will take."""
        self.course.videos = guess.videos
        for line in estimate_lines(guess):
            self.say(line)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """A line when a stage is through."""
        self.count(plan, stage, part, outcome)
        if not plan.stages[stage].todo and outcome.state == "done":
            self.say(f"{plan.name}: {stage} done ({time.monotonic() - self.begun:.0f} s)")

    def count(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Keep what a part took."""
        self.tally.add(plan, stage, part, outcome)
        self.course.done += 1

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """A line a video, and how far the batch is."""
        self.course.finished += 1
        for line in video_lines(plan, summary):
            self.say(line)
        self.stands()

    def failed(self, name: str, message: str) -> None:
        """A line a failure."""
        self.course.fail(name in self.names)
        self.say(f"failed: {name}: {message}")
        self.stands()

    def stands(self) -> None:
        """How far the batch is."""
        if self.course.many:
            self.say(self.course.words())

    def note(self, text: str) -> None:
        """A line about the run as a whole."""
        self.say(text)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
            words, total = self.course.words().partition(" parts")[0], max(self.course.expected, 1)
            self.progress.update(
                self.all, description=f"{words} parts", completed=self.course.done, total=total
            )

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
        print(f"{guess.videos} videos: {_to_do(guess)}", file=sys.stderr, flush=True)

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
        f"zsmoseg: {len(failures)} of {videos} videos failed; what was finished is kept",
        *(f"  {names:<{width}}  {message}" for names, message in rows),
        f"  again: {again}",
    ]


def estimate_lines(guess: Estimate) -> list[str]:
    """How many videos were not shown, and the estimate."""
    more = (
        [f"... and {guess.videos - SHOWN} more videos (all with --dry-run)"] if guess.videos > SHOWN else []
    )
    return [*more, _to_do(guess)]


def _to_do(guess: Estimate) -> str:
    return estimate_line(guess) if guess.seconds else "nothing to do"


def video_lines(plan: VideoPlan, summary: dict[str, Any] | None) -> list[str]:
    """What came out of a video."""
    if summary is None:
        return [f"{plan.name}: {len(plan.probe.times)} frames, done up to {list(plan.stages)[-1]}"]
    moving = summary["moving_groups"]
    lines = [
        f"{plan.name}: {summary['frames']} frames, {summary['objects']} objects, "
        f"{moving} moving group{'' if moving == 1 else 's'}, {summary['moving_pixels_percent']:.1f} % of the pixels move"
    ]
    lines += [f"  {line}" for line in (brought_lines(plan) if plan.settled is None else [])]
    lines += [f"  warning: {text}" for text in summary["warnings"]]
    return [*lines, f"  masks: {plan.output.path / 'masks'}"]


def tally_lines(tally: Tally, wall: float) -> list[str]:
    """Seconds and memory per stage."""
    lines = [f"{'stage':<11} {'seconds':>8} {'ms/frame':>9} {'peak MB':>8}"]
    lines += [f"{s:<11} {sec:>8.2f} {ms:>9.1f} {mb:>8.0f}" for s, sec, ms, mb in tally.rows()]
    total = sum(tally.seconds.values())
    return [*lines, f"{'all':<11} {total:>8.2f}   in {wall:.1f} s"]
