"""What a user asked for, who looks on, and how it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from zsmoseg.settings import Settings
from zsmoseg.workflows.planning.estimate import Estimate
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome


@dataclass(frozen=True)
class Request:
    """What a user asked for."""

    sources: Sequence[str]
    out: Path = Path("zsmoseg-out")
    store: Path = Path("zsmoseg-store")
    settings: Settings = field(default_factory=Settings)
    scheduler: Any = "local"
    workers: int | None = None
    start_from: str | None = None
    until: Sequence[str] = ()


class Watcher(Protocol):
    """Who looks on."""

    def planned(self, plans: Sequence[VideoPlan], guess: Estimate) -> None:
        """The plan is made, nothing is started."""

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part came back."""

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """One video is finished."""

    def failed(self, name: str, message: str) -> None:
        """One video failed; the others go on."""


class Quiet:
    """Nobody looks on."""

    def planned(self, plans: Sequence[VideoPlan], guess: Estimate) -> None:
        """Ignore."""

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """Ignore."""

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """Ignore."""

    def failed(self, name: str, message: str) -> None:
        """Ignore."""


@dataclass
class Report:
    """How a run ended; ``run`` is its id in the store."""

    plans: list[VideoPlan]
    summaries: dict[str, dict[str, Any]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    traces: dict[str, str] = field(default_factory=dict)
    run: str = ""
