"""A run: plan every video, submit what is missing, keep what is finished, say how it ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from zsmoseg.errors import SpaceError, StageError, ZsmosegError
from zsmoseg.networks.session import chosen_provider
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import RunRecord
from zsmoseg.video.probe import Excerpt, probe
from zsmoseg.video.sources import sources, unique_names
from zsmoseg.workflows.planning.estimate import (
    estimate,
    estimate_line,
    fitting_workers,
    models_of,
    refuse_full_disk,
)
from zsmoseg.workflows.planning.plan import VideoPlan, explain_plan, plan_video
from zsmoseg.workflows.running.artifacts import plans_record, prepare, seal_video
from zsmoseg.workflows.running.executors import Executor, make_executor
from zsmoseg.workflows.running.jobs import Job, Outcome
from zsmoseg.workflows.running.request import Quiet, Report, Request, Watcher
from zsmoseg.workflows.running.trust import promised
from zsmoseg.workflows.stages.graph import names

SMALL = 15.0
"""A plan below this many estimated seconds runs in this process: a cluster would take longer to start."""
IN_FLIGHT = 4
"""Videos whose jobs are with the executor at once."""


def make_plans(request: Request, store: Store) -> tuple[list[VideoPlan], dict[str, str]]:
    """The plans of all sources, and what is wrong with those that have none.

    Raises
    ------
    ZsmosegError
        If not one source can be planned: the first error.
    """
    found = sources(request.sources)
    plans, failures = [], {}
    for source, name in zip(found, unique_names(found), strict=True):
        try:
            plans.append(_make_plan(request, store, source, name, len(found) == 1))
        except ZsmosegError as error:
            if len(found) == 1:
                raise
            failures[name] = str(error)
    if not plans:
        raise StageError(next(iter(failures.values())))
    return plans, failures


def _make_plan(request: Request, store: Store, source: str, name: str, alone: bool) -> VideoPlan:
    settings = request.settings
    fingerprint = store.fingerprint(source, settings.video.fingerprint)
    looked = probe(source, settings.video.parameters(Excerpt))
    video = store.video_id(name, fingerprint)
    return plan_video(
        store,
        source,
        name,
        video,
        fingerprint,
        looked,
        settings,
        str(request.out / name),
        request.start_from,
        request.until,
        alone,
    )


def run(request: Request, watcher: Watcher | None = None) -> Report:
    """Run what is missing.

    Raises
    ------
    ZsmosegError
        Before anything is started: bad sources, settings, store, output folder, too little disk.
    """
    watcher = watcher or Quiet()
    store = Store.open(request.store, create=True)
    plans, failures = make_plans(request, store)
    guess = estimate(store, plans)
    refuse_full_disk(request.store, guess)
    if request.scheduler in ("local", "serial") and any(models_of(plans)):
        chosen_provider(request.settings.networks.provider)
    watcher.planned(plans, guess)
    report = Report(plans, failures=failures)
    for name, message in failures.items():
        watcher.failed(name, message)
    record = RunRecord.begin(store, request.settings.flat(), plans_record(plans))
    report.run = record.content["id"]
    state = "interrupted"
    try:
        plans = [plan for plan in plans if _prepared(store, plan, report, watcher)]
        scheduler = request.scheduler
        if scheduler == "local" and guess.seconds < SMALL:
            scheduler = "serial"
        busy = [plan for plan in plans if plan.todo]
        for plan in plans:
            if not plan.todo:
                _finish(plan, request, report, watcher)
        if busy:
            with make_executor(scheduler, request.workers or fitting_workers(busy)) as executor:
                _drive(executor, busy, request, report, watcher)
        state = "failed" if report.failures else "done"
    finally:
        record.end(state, report.failures, report.traces)
    return report


def _prepared(store: Store, plan: VideoPlan, report: Report, watcher: Watcher) -> bool:
    """Lay out what a video needs; whether that went well."""
    try:
        prepare(store, plan)
    except SpaceError:
        raise
    except ZsmosegError as error:
        report.failures[plan.name] = str(error)
        watcher.failed(plan.name, str(error))
        return False
    return True


def _drive(
    executor: Executor,
    plans: Sequence[VideoPlan],
    request: Request,
    report: Report,
    watcher: Watcher,
) -> None:
    """Keep a window of videos with the executor until all are through."""
    waiting = iter(enumerate(plans))
    running: dict[str, _Running] = {}

    def more() -> None:
        index, plan = next(waiting, (0, None))
        if plan is not None:
            videos = _Running(plan, {})
            for job, before, priority in jobs(request, plan, index, executor.threads):
                videos.left[job.name] = job
                running[job.name] = videos
                executor.submit(job, before, priority)

    for _ in range(IN_FLIGHT):
        more()
    for name, outcome in executor.results():
        video = running.pop(name)
        job = video.left.pop(name)
        video.names.append(name)
        _note(video, job, outcome, watcher)
        if not video.left:
            executor.release(video.names)
            if video.trace:
                report.traces[video.plan.name] = video.trace
            if video.failure:
                report.failures[video.plan.name] = video.failure
                watcher.failed(video.plan.name, video.failure)
            else:
                _finish(video.plan, request, report, watcher)
            more()


@dataclass
class _Running:
    """A video whose jobs are with the executor."""

    plan: VideoPlan
    left: dict[str, Job]
    names: list[str] = field(default_factory=list)
    failure: str = ""
    trace: str = ""


def _note(video: _Running, job: Job, outcome: Outcome, watcher: Watcher) -> None:
    """Keep what one job left; the first failure names the frames and what to do."""
    plan, stage = video.plan, video.plan.stages[job.stage]
    if outcome.state == "failed" and not video.failure:
        video.failure = (
            f"{plan.source}: {job.stage}, frames {job.start} to {job.stop - 1}: {outcome.error} "
            "(what was finished is kept; the same command goes on from there)"
        )
        video.trace = outcome.trace
    if outcome.state == "done":
        if stage.stage.output:
            plan.output.add((outcome.facts or {})["files"], stage.key)
        stage.todo.remove(job.part)
    watcher.part(plan, job.stage, job.part, outcome)


def jobs(
    request: Request, plan: VideoPlan, index: int, threads: int = 1
) -> Iterator[tuple[Job, list[str], int]]:
    """The jobs of a video in order, the names of those before each, and their priority.

    Earlier videos first, later stages first within a video. ``threads``: within a network, unless a setting says.
    """
    named: dict[tuple[str, int], str] = {}
    networks = request.settings.networks.model_dump(mode="json")
    networks["threads"] = networks["threads"] or threads
    for place, (name, stage) in enumerate(plan.stages.items()):
        for part in stage.todo:
            start, stop = stage.parts[part]
            job = Job(
                str(request.store),
                plan.video,
                name,
                stage.key,
                part,
                start,
                stop,
                plan.stages["frames"].key,
                stage.settings,
                stage.inputs,
                str(plan.output.path),
                plan.graph,
                networks,
                bool(stage.models),
                promised(plan, stage, request.settings.video.fingerprint),
            )
            named[name, part] = job.name
            before = [named[b] for b in plan.before(stage, part) if b in named]
            yield job, before, place - len(names()) * index


def _finish(plan: VideoPlan, request: Request, report: Report, watcher: Watcher) -> None:
    """Seal what is complete; clear and describe the output folder."""
    try:
        summary = seal_video(plan, request.settings)
    except ZsmosegError as error:
        report.failures[plan.name] = str(error)
        watcher.failed(plan.name, str(error))
        return
    if summary is not None:
        report.summaries[plan.name] = summary
    watcher.finished(plan, summary)


def dry_run(request: Request) -> list[str]:
    """The plan in words; nothing is written."""
    store = Store(request.store)
    if store.path.exists():
        store = Store.open(request.store, create=False)
    plans, failures = make_plans(request, store)
    guess = estimate(store, plans)
    lines = explain_plan(plans) + [f"{name}: {message}" for name, message in failures.items()]
    return [*lines, estimate_line(guess) if any(plan.todo for plan in plans) else "nothing to do"]
