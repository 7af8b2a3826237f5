"""What a user asked for, who looks on, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from traceback import format_exception
from typing import Any, Literal, Protocol

from zsmoseg.errors import StageError, ZsmosegError, in_words
from zsmoseg.settings import Settings
from zsmoseg.workflows.planning.estimate import Estimate
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome

PATIENCE = 300.0
"""Seconds that a run waits while a cluster has no worker: batch queues and adaptive clusters start some in minutes."""
SUMMARY = ("frames", "objects", "moving_groups", "moving_pixels_percent", "warnings")
"""What is kept and told of summary.json."""


@dataclass(frozen=True)
class Choice:
    """Which of the videos that the sources hold are meant.

    Attributes
    ----------
    only
        Names or patterns of names; none: all.
    share
        (i, n): the i-th of n shares, from 1.
    retry_failed
        Those that failed or were interrupted when they ran last with this store.
    limit
        As many at most.
    """

    only: Sequence[str] = ()
    share: tuple[int, int] | None = None
    retry_failed: bool = False
    limit: int | None = None


Keep = Literal["masks", "cues", "all"]
"""Which artifacts stay in the store once a video is finished."""
RESULTS = frozenset({"objects", "labels", "residuals", "affinity", "groups"})
"""Stages that results, exports of masks and ``explain`` read."""
KEPT: dict[Keep, frozenset[str]] = {
    "masks": RESULTS,
    "cues": RESULTS | {"frames", "flow", "depth", "proposals"},
}
"""What stays; not in it: everything."""


@dataclass(frozen=True)
class Request:
    """What a user asked for; ``steal``: take what expired leases hold without watching whether they beat; ``keep``: what stays;
    ``imports``: what is brought is noted for the runs to come.
    """

    sources: Sequence[str]
    out: PurePath = Path("zsmoseg-out")
    store: PurePath = Path("zsmoseg-store")
    settings: Settings = field(default_factory=Settings)
    scheduler: Any = "local"
    workers: int | None = None
    start_from: str | None = None
    until: Sequence[str] = ()
    choice: Choice = Choice()
    patience: float = PATIENCE
    steal: bool = False
    keep: Keep = "all"
    imports: bool = False


class Watcher(Protocol):
    """Who looks on."""

    def planned(self, plan: VideoPlan) -> None:
        """One video is planned; nothing of it is started."""

    def estimated(self, guess: Estimate) -> None:
        """What the run will take, going by the videos planned so far; the others are planned while it goes on."""

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part came back."""

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """One video is finished."""

    def failed(self, name: str, message: str) -> None:
        """One video failed; the others go on."""

    def note(self, text: str) -> None:
        """Something about the run as a whole: what it waits for."""


class Quiet:
    """Nobody looks on."""

    def planned(self, plan: VideoPlan) -> None:
        """Ignore."""

    def estimated(self, guess: Estimate) -> None:
        """Ignore."""

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Ignore."""

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """Ignore."""

    def failed(self, name: str, message: str) -> None:
        """Ignore."""

    def note(self, text: str) -> None:
        """Ignore."""


@dataclass
class Report:
    """How a run ended.

    Attributes
    ----------
    names
        Of all videos that were meant.
    run
        Its id in the store, which has the keys that each video reached.
    planned, finished
        Videos that could be planned, and that are done.
    summaries, failures, traces
        By name: the front of summary.json; why a video failed, and where, if nobody expected that.
    started
        Not every video failed before anything of it was computed.
    """

    names: Sequence[str] = ()
    run: str = ""
    planned: set[str] = field(default_factory=set)
    finished: list[str] = field(default_factory=list)
    summaries: dict[str, dict[str, Any]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    traces: dict[str, str] = field(default_factory=dict)
    started: bool = False

    def finish(self, name: str, summary: Mapping[str, Any] | None) -> None:
        """Note a video that is done."""
        self.finished.append(name)
        if summary is not None:
            self.summaries[name] = {told: summary[told] for told in SUMMARY}

    def fail(self, name: str, failure: Failure, watcher: Watcher) -> None:
        """Note a video that failed, and tell who looks on."""
        self.failures[name] = failure.message
        if failure.trace:
            self.traces[name] = failure.trace
        watcher.failed(name, failure.message)


def none_can_run(failures: Sequence[Failure]) -> StageError:
    """The error where not one video can be planned."""
    first, many = failures[0].message, len(failures)
    return StageError(first if many == 1 else f"none of the {many} videos can be run; the first: {first}")


@dataclass(frozen=True)
class Failure:
    """Why a video failed: a line, and for what nobody expected where it happened."""

    message: str
    trace: str = ""

    @classmethod
    def of(cls, error: Exception, source: str) -> Failure:
        """What was raised, in one line that names the video."""
        if isinstance(error, ZsmosegError):
            return cls(str(error))
        words = in_words(error)
        if words is not None:
            named = words if words.startswith(f"{source}:") else f"{source}: {words}"
            return cls(f"{named}; mend that and run the same command again")
        trace = "".join(format_exception(error))
        return cls(f"{source}: unexpected {type(error).__name__}: {error}", trace)
