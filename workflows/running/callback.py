"""How far a run is, told to a function of the user: parts done, parts in all as far as they are planned, what was done last."""

from __future__ import annotations

from collections.abc import Callable

from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet

Progress = Callable[[int, int, str], object]
"""Takes the number of parts done, of parts in all, and the stage that was done last, or what the run waits for."""


class Told(Quiet):
    """Calls ``tell`` after every plan and every part; what it raises ends the run, and what is finished is kept."""

    def __init__(self, tell: Progress) -> None:
        self._tell = tell
        self._done = self._parts = 0

    def planned(self, plan: VideoPlan) -> None:
        """More parts to do, or none."""
        self._parts += plan.todo
        self._tell(self._done, self._parts, "planned")

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        """One part more is done."""
        self._done += 1
        self._tell(self._done, self._parts, stage)

    def note(self, text: str) -> None:
        """What is waited for."""
        self._tell(self._done, self._parts, text)
