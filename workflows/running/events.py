"""What happens in a run as JSON lines, for programs that look on: one object a line, written as it happens."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from zsmoseg.errors import OutputError, in_words
from zsmoseg.stores import files
from zsmoseg.workflows.planning.estimate import Estimate
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import SUMMARY, Report, Watcher


class Events:
    """Writes the events, and tells another watcher what it is told itself.

    Every line has ``time`` (UTC, ISO 8601) and ``event``: ``planned``, ``estimated``, ``part``, ``finished``,
    ``failed``, ``note`` and, last, ``ended`` or ``stopped``; docs/cluster.md has the other names.
    """

    def __init__(self, path: Path, watcher: Watcher) -> None:
        self.path, self.watcher = path, watcher
        try:
            self._file: Any = path.open("ab", buffering=0)
        except (OSError, ValueError) as error:
            raise OutputError(f"--events: {in_words(error) or error}; give another file") from error

    def _write(self, event: str, **what: Any) -> None:
        """One line; a disk that is full ends the events, not the run."""
        if self._file is None:
            return
        line = {"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "event": event, **what}
        try:
            self._file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        except OSError as error:
            self._file.close()
            self._file = None
            self.watcher.note(f"--events {self.path}: no more events are written ({in_words(error)})")

    def planned(self, plan: VideoPlan) -> None:
        """One video is planned."""
        self._write("planned", video=plan.name, parts=plan.todo)
        self.watcher.planned(plan)

    def estimated(self, guess: Estimate) -> None:
        """Once, before anything is computed."""
        self._write(
            "estimated",
            videos=guess.videos,
            looked=guess.looked,
            seconds=round(guess.seconds, 3),
            lasts=None if guess.lasts is None else round(guess.lasts, 3),
            megabytes=round(guess.size / 1e6, 3),
        )
        self.watcher.estimated(guess)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part came back."""
        start, stop = plan.stages[stage].parts[part]
        about: dict[str, Any] = {
            "video": plan.name,
            "stage": stage,
            "part": part,
            "frames": [start, stop - 1],
            "state": outcome.state,
        }
        if outcome.state == "done":
            about |= {"seconds": round(outcome.seconds, 4), "memory_mb": outcome.memory_mb}
        if outcome.error:
            about["error"] = outcome.error
        self._write("part", **about)
        self.watcher.part(plan, stage, part, outcome)

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """One video is finished."""
        about = {name: summary[name] for name in SUMMARY} if summary else {}
        self._write("finished", video=plan.name, out=files.absolute(plan.output.path), **about)
        self.watcher.finished(plan, summary)

    def failed(self, name: str, message: str) -> None:
        """One video failed."""
        self._write("failed", video=name, error=message)
        self.watcher.failed(name, message)

    def note(self, text: str) -> None:
        """Something about the run as a whole."""
        self._write("note", text=text)
        self.watcher.note(text)

    def ended(self, report: Report) -> None:
        """The last line of a run that was not stopped."""
        self._write("ended", run=report.run, finished=len(report.finished), failed=len(report.failures))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            if error is not None:
                self._write("stopped", error=str(error) or type(error).__name__)
            self._file.close()
