"""How far a batch is: videos, frames, failures, and how long it may still take."""

from __future__ import annotations

import time
from collections.abc import Sequence

from zsmoseg.workflows.planning.estimate import Estimate, part_seconds
from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
from zsmoseg.workflows.planning.rates import Rates
from zsmoseg.workflows.wording import counted, duration

LEAST = 1e-6
"""Seconds of a part at least: every part counts."""


class Course:
    """What is done of what there is; frames of a video count by the part of its work that is done."""

    def __init__(self, rates: Rates | None = None) -> None:
        self.begun, self._rates = time.monotonic(), rates or Rates()
        self.videos = self.planned = self.finished = self.failed = 0
        self.frames = self._unplanned = 0
        self._whole: dict[str, tuple[float, int]] = {}  # of videos at work: seconds of all, and frames
        self._done = self._through = self._seconds = 0.0
        self._lasts: float | None = None

    def plan(self, plan: VideoPlan) -> None:
        """One more video was planned."""
        self.planned += 1
        self.videos = max(self.videos, self.planned)
        seconds = sum(sum(self._of(plan, stage, stage.todo)) for stage in plan.stages.values() if stage.todo)
        self._whole[plan.name] = seconds, len(plan.probe.times)
        self.frames += len(plan.probe.times)
        self._seconds += seconds

    def estimated(self, guess: Estimate) -> None:
        """How many there are."""
        self.videos, self._lasts = guess.videos, guess.lasts

    def part(self, plan: VideoPlan, stage: str, part: int) -> None:
        """A part is through, whatever became of it."""
        (seconds,) = self._of(plan, plan.stages[stage], [part])
        whole, frames = self._whole[plan.name]
        self._done += seconds
        self._through += frames * seconds / max(whole, seconds)

    def finish(self, plan: VideoPlan) -> None:
        """A video is finished; one with nothing to do was before it began."""
        self.finished += 1
        whole, frames = self._whole.pop(plan.name)
        self._through += 0.0 if whole else frames

    def fail(self, name: str) -> None:
        """One more failed, before or after it was planned."""
        self.failed += 1
        self._unplanned += self._whole.pop(name, None) is None
        self.videos = max(self.videos, self.planned + self._unplanned)

    def _of(self, plan: VideoPlan, stage: StagePlan, parts: Sequence[int]) -> list[float]:
        rate = self._rates.of(stage)
        return [max(part_seconds(plan, stage, part, rate), LEAST) for part in parts]

    @property
    def share(self) -> float:
        """Part of the work of all videos that is done, those that are not planned yet taken to be like the others."""
        coming = max(self.videos - self.planned - self._unplanned, 0)
        return self._done / max(self._seconds * (1 + coming / max(self.planned, 1)), LEAST)

    @property
    def many(self) -> bool:
        """Whether there is a batch to speak of."""
        return self.videos > 1

    def words(self) -> str:
        """``12 of 90 videos, 1 failed, 480 of about 3600 frames, about 2.5 h left``."""
        failed = f", {self.failed} failed" if self.failed else ""
        coming = max(self.videos - self.planned - self._unplanned, 0)
        about = "about " if coming else ""
        frames = self.frames + round(coming * self.frames / max(self.planned, 1))
        videos = f"{self.finished} of {counted(self.videos, 'video')}"
        text = f"{videos}{failed}, {int(self._through + LEAST)} of {about}{frames} frames"
        return text if self.left is None else f"{text}, about {duration(self.left)} left"

    @property
    def left(self) -> float | None:
        """Seconds, as it went so far, at first as it was estimated; None where nobody knows, or nothing is left."""
        gone = time.monotonic() - self.begun
        if self.finished + self.failed == self.videos or self.share >= 1:
            return None
        if self._done:
            return gone / self.share * (1 - self.share)
        return None if self._lasts is None else max(self._lasts - gone, 0.0)
