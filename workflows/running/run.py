"""A run: plan every video, submit what is missing, keep what is finished, say how it ended."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from zsmoseg.errors import (
    ClusterError,
    SpaceError,
    StageError,
    ZsmosegError,
    in_words,
    system_errors_in_words,
)
from zsmoseg.networks.session import chosen_provider
from zsmoseg.remote.looks import one_look
from zsmoseg.stores import files
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
from zsmoseg.workflows.running.choosing import Named, choose, nothing_left
from zsmoseg.workflows.running.executors import Executor, make_executor
from zsmoseg.workflows.running.jobs import Job, Outcome
from zsmoseg.workflows.running.request import Failure, Quiet, Report, Request, Watcher
from zsmoseg.workflows.running.trust import promised
from zsmoseg.workflows.running.workers import Needs
from zsmoseg.workflows.stages.graph import names

SMALL = 15.0
"""A plan below this many estimated seconds runs in this process: a cluster would take longer to start."""
IN_FLIGHT = 4
"""Videos whose jobs are with the executor at once."""


def found_in(request: Request) -> list[Named]:
    """The videos that the sources hold, and their names.

    Raises
    ------
    VideoError
        A source means nothing; two have one name.
    """
    found = sources(request.sources)
    return list(zip(found, unique_names(found), strict=True))


def make_plans(
    request: Request, store: Store, found: Sequence[Named] | None = None
) -> tuple[list[VideoPlan], dict[str, Failure]]:
    """The plans of all videos that are meant, and what is wrong with those that have none.

    Parameters
    ----------
    found
        What ``found_in`` gives, if that was asked already.

    Raises
    ------
    ZsmosegError
        If not one can be planned: the first error; if ``--only`` names no video.
    """
    found = found_in(request) if found is None else found
    meant = choose(found, request.choice, store)
    plans, failures = [], {}
    for source, name in meant:
        try:
            plans.append(_make_plan(request, store, source, name, len(found) == 1))
        except Exception as error:
            if len(meant) == 1 and isinstance(error, ZsmosegError):
                raise
            failures[name] = Failure.of(error, source)
    if failures and not plans:
        first, many = next(iter(failures.values())).message, len(failures)
        raise StageError(first if many == 1 else f"none of the {many} videos can be run; the first: {first}")
    return plans, failures


def _make_plan(request: Request, store: Store, source: str, name: str, alone: bool) -> VideoPlan:
    with one_look():
        return _planned(request, store, source, name, alone)


def _planned(request: Request, store: Store, source: str, name: str, alone: bool) -> VideoPlan:
    settings = request.settings
    fingerprint = store.fingerprint(source, settings.video.fingerprint)
    looked = probe(source, settings.video.parameters(Excerpt))
    video = store.video_id(name, fingerprint)
    with files.looking_at(store.video(video).path, request.out / name):
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
        Before anything is started: bad sources, settings, store, output folder, too little disk, no cluster.
    """
    watcher = watcher or Quiet()
    with system_errors_in_words(), one_look():
        place, _ = files.folder(request.store), files.folder(request.out)
        found = found_in(request)
        store = Store.open(place, create=True)
        plans, failures = make_plans(request, store, found)
        report = Report(plans)
        if not plans:
            watcher.note(nothing_left(len(found), request.choice))
            return report
        guess = estimate(store, plans)
        refuse_full_disk(request.store, guess)
        if request.scheduler in ("local", "serial") and any(models_of(plans)):
            chosen_provider(request.settings.networks.provider)
        watcher.planned(plans, guess)
        record = RunRecord.begin(store, request.settings.flat(), plans_record(plans))
    report.run = record.content["id"]
    for name, failure in failures.items():
        report.fail(name, failure, watcher)
    state = "interrupted"
    try:
        _compute(request, store, record, report, guess.seconds, watcher)
        state = "failed" if report.failures else "done"
    finally:
        _end(record, state, report, watcher)
    return report


def _compute(
    request: Request, store: Store, record: RunRecord, report: Report, seconds: float, watcher: Watcher
) -> None:
    """Lay out every video, hand what is to do to an executor, finish the others."""
    for plan in report.plans:
        try:
            prepare(store, plan)
        except SpaceError:
            raise
        except Exception as error:
            report.fail(plan.name, Failure.of(error, plan.source), watcher)
    good = [plan for plan in report.plans if plan.name not in report.failures]
    busy = [plan for plan in good if plan.todo]
    report.started = bool(good)
    for plan in good:
        if not plan.todo:
            _finish(plan, request, report, watcher)
    if not busy:
        return
    small = request.scheduler == "local" and seconds < SMALL
    outs = [
        files.absolute(plan.output.path) for plan in busy if any(s.stage.output for s in plan.stages.values())
    ]
    needs = Needs.of(
        files.absolute(store.path), files.absolute(record.path), [plan.probe.source for plan in busy], outs
    )
    executor = make_executor(
        "serial" if small else request.scheduler,
        request.workers or fitting_workers(busy),
        needs,
        request.patience,
        watcher.note,
    )
    started = False
    try:
        with executor:
            started = True
            _drive(executor, busy, request, report, watcher)
    except ClusterError as error:
        if not started:
            raise
        for plan in busy:
            if plan.name not in report.failures and plan.name not in report.finished:
                report.fail(plan.name, Failure(f"not finished: {error}"), watcher)


def _end(record: RunRecord, state: str, report: Report, watcher: Watcher) -> None:
    """Note how the run ended; a store that is full or gone by now keeps what it has."""
    try:
        record.end(state, report.failures, report.traces)
    except (OSError, ZsmosegError) as error:
        watcher.note(f"how the run ended cannot be noted in the store: {in_words(error) or error}")


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
            if video.failure:
                report.fail(video.plan.name, video.failure, watcher)
            else:
                _finish(video.plan, request, report, watcher)
            more()


@dataclass
class _Running:
    """A video whose jobs are with the executor."""

    plan: VideoPlan
    left: dict[str, Job]
    names: list[str] = field(default_factory=list)
    failure: Failure | None = None


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
            )
            named[name, part] = job.name
            before = [named[b] for b in plan.before(stage, part) if b in named]
            yield job, before, place - len(names()) * index


def _finish(plan: VideoPlan, request: Request, report: Report, watcher: Watcher) -> None:
    """Seal what is complete; clear and describe the output folder."""
    try:
        with files.looking_at(request.store / plan.video, plan.output.path):
            summary = seal_video(plan, request.settings)
    except Exception as error:
        report.fail(plan.name, Failure.of(error, plan.source), watcher)
        return
    if summary is not None:
        report.summaries[plan.name] = summary
    report.finished.append(plan.name)
    watcher.finished(plan, summary)


def dry_run(request: Request) -> list[str]:
    """The plan in words; nothing is written."""
    with system_errors_in_words(), one_look():
        store = Store(files.folder(request.store))
        if files.exists(store.path):
            store = Store.open(request.store, create=False)
        found = found_in(request)
        plans, failures = make_plans(request, store, found)
        if not plans:
            return [nothing_left(len(found), request.choice)]
        guess = estimate(store, plans)
    lines = explain_plan(plans) + [f"{name}: {failure.message}" for name, failure in failures.items()]
    return [*lines, estimate_line(guess) if any(plan.todo for plan in plans) else "nothing to do"]
