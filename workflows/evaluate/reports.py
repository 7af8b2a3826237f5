"""The forms in which a scoreboard is printed, by name; a new one is a function and its line here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from zsmoseg.metrics.registries import Deferred

if TYPE_CHECKING:
    from zsmoseg.workflows.evaluate.scoreboard import Scoreboard


@dataclass(frozen=True)
class Report:
    """One form: the ending of a file of it, and what writes it."""

    ending: str
    write: Callable[[Scoreboard], str]


REPORTS: dict[str, Report] = {
    "text": Report(".txt", Deferred("zsmoseg.workflows.evaluate.report_tables:as_text")),
    "csv": Report(".csv", Deferred("zsmoseg.workflows.evaluate.report_tables:as_csv")),
    "json": Report(".json", Deferred("zsmoseg.workflows.evaluate.report_tables:as_json_text")),
    "markdown": Report(".md", Deferred("zsmoseg.workflows.evaluate.report_tables:as_markdown")),
    "latex": Report(".tex", Deferred("zsmoseg.workflows.evaluate.report_tables:as_latex")),
}


def render(board: Scoreboard, kind: str) -> str:
    """The scoreboard in one of ``REPORTS``, with a newline at the end."""
    return REPORTS[kind].write(board).rstrip("\n") + "\n"
