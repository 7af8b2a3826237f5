"""Jobs of a few videos at once with an executor: as many as keep it busy, a new video for each that is through."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from zsmoseg.errors import ZsmosegError
from zsmoseg.stores import files
from zsmoseg.workflows.planning.estimate import part_seconds
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.planning.rates import Rates, Taken, work
from zsmoseg.workflows.running.batch import Batch
from zsmoseg.workflows.running.deadlines import deadline
from zsmoseg.workflows.running.executors import Executor
from zsmoseg.workflows.running.jobs import Job, Outcome
from zsmoseg.workflows.running.request import Failure, Request, Watcher
from zsmoseg.workflows.running.trust import promised
from zsmoseg.workflows.running.whole import TINY
from zsmoseg.workflows.stages.graph import names

IN_FLIGHT = 4
"""Videos whose jobs are with the executor at least."""
AHEAD = 8
"""Jobs a slot of the executor with which more videos may be added: short videos have few at a time that can run."""


@dataclass
class _Running:
    """A video whose jobs are with the executor."""

    plan: VideoPlan
    left: dict[str, Job] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    failure: Failure | None = None


class Drive:
    """Takes videos from ``batch``, after those that are planned already (``first``), until all are through."""

    def __init__(self, executor: Executor, batch: Batch, first: deque[VideoPlan]) -> None:
        self._executor, self._batch, self._first = executor, batch, first
        self._running: dict[str, _Running] = {}
        self._videos = self._taken = 0
        self.useful = 0.0  # seconds by the clock that tasks had

    def run(self) -> None:
        """Until nothing is left.

        Raises
        ------
        ZsmosegError
            What stops all videos.
        """
        self._fill()
        while self._running:
            for name, outcome in self._executor.results():
                self._through(name, outcome)
                self._fill()

    def _room(self) -> bool:
        slots = self._executor.slots
        return self._videos < IN_FLIGHT or (self._videos < 2 * slots and len(self._running) < AHEAD * slots)

    def _fill(self) -> None:
        while self._room():
            plan = self._first.popleft() if self._first else self._batch.take()
            if plan is None:
                return
            if self._batch.begin(plan):
                self._submit(plan)

    def _submit(self, plan: VideoPlan) -> None:
        video = _Running(plan)
        found = list(jobs(self._batch.request, plan, self._taken, self._executor.threads, self._batch.rates))
        for job, _, _ in found:
            video.left[job.name] = job
            self._running[job.name] = video
        if found and self._batch.guess([plan]).seconds < TINY and not any(job.network for job, _, _ in found):
            self._executor.submit_whole([(job, before) for job, before, _ in found], found[0][2])
        else:
            for job, before, priority in found:
                self._executor.submit(job, before, priority)
        self._taken += 1
        if video.left:
            self._videos += 1
        else:  # another run has done it all since this one was planned
            self._batch.finish(plan)

    def _through(self, name: str, outcome: Outcome) -> None:
        """One job is through; after the last one its video is."""
        video = self._running.pop(name)
        job = video.left.pop(name)
        video.names.append(name)
        self._count(video.plan, job, outcome)
        _note(video, job, outcome, self._batch.watcher)
        if outcome.stops:
            raise ZsmosegError(outcome.error)
        if video.left:
            return
        self._executor.release(video.names)
        self._videos -= 1
        if video.failure:
            self._batch.fail(video.plan, video.failure)
        else:
            self._batch.finish(video.plan)

    def _count(self, plan: VideoPlan, job: Job, outcome: Outcome) -> None:
        """Keep what a job took, for estimates to come."""
        self.useful += outcome.wall + outcome.warm_up
        if outcome.state == "done" and not outcome.found:
            stage, frames = plan.stages[job.stage], job.stop - job.start
            done, written = work(plan, stage, frames), (outcome.facts or {}).get("files", {})
            size = float(sum(file["size"] for file in written.values()))
            taken = Taken(outcome.seconds, outcome.wall, done, size, done if written else 0.0)
            self._batch.rates.add(stage, taken)


def _note(video: _Running, job: Job, outcome: Outcome, watcher: Watcher) -> None:
    """Keep what one job left; the first failure names the frames and what to do."""
    plan, stage = video.plan, video.plan.stages[job.stage]
    if outcome.state == "failed" and video.failure is None:
        video.failure = Failure(
            f"{plan.source}: {job.stage}, frames {job.start} to {job.stop - 1}: {outcome.error} "
            "(what was finished is kept; the same command goes on from there)",
            outcome.trace,
        )
    if outcome.state == "done":
        try:
            if stage.stage.output:
                plan.output.add((outcome.facts or {})["files"], stage.key)
            stage.todo.remove(job.part)
        except Exception as error:
            video.failure = video.failure or Failure.of(error, plan.source)
    watcher.part(plan, job.stage, job.part, outcome)


def jobs(
    request: Request, plan: VideoPlan, index: int, threads: int, rates: Rates
) -> Iterator[tuple[Job, list[str], int]]:
    """The jobs of a video in order, the names of those before each, and their priority.

    Earlier videos first, later stages first within a video. ``threads``: within a network, unless a setting says.
    """
    named: dict[tuple[str, int], str] = {}
    networks = request.settings.networks.model_dump(mode="json")
    networks["threads"] = networks["threads"] or threads
    for place, (name, stage) in enumerate(plan.stages.items()):
        rate = rates.of(stage)
        for part in stage.todo:
            start, stop = stage.parts[part]
            job = Job(
                files.absolute(request.store),
                plan.video,
                name,
                stage.key,
                part,
                start,
                stop,
                plan.stages["frames"].key,
                stage.settings,
                stage.inputs,
                files.absolute(plan.output.path),
                plan.graph,
                networks,
                bool(stage.models),
                promised(plan, stage, request.settings.video.fingerprint),
                stage.packed,
                request.steal,
                deadline(part_seconds(plan, stage, part, rate)),
            )
            named[name, part] = job.name
            before = [named[b] for b in plan.before(stage, part) if b in named]
            yield job, before, place - len(names()) * index
