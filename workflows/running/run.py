"""A run: plan videos while others are computed, keep what is finished, say how it ended."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from zsmoseg.errors import ZsmosegError, system_errors_in_words
from zsmoseg.networks.session import chosen_provider
from zsmoseg.remote.looks import one_look
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import DONE, FAILED, INTERRUPTED
from zsmoseg.video.sources import sources, unique_names
from zsmoseg.workflows.planning.estimate import (
    Estimate,
    estimate,
    estimate_lines,
    fitting_workers,
    models_of,
    refuse_full_disk,
)
from zsmoseg.workflows.planning.plan import VideoPlan, explain_plan
from zsmoseg.workflows.planning.rates import Rates
from zsmoseg.workflows.running.batch import Batch
from zsmoseg.workflows.running.choosing import Named, choose, nothing_left, without_outputs
from zsmoseg.workflows.running.driving import Drive
from zsmoseg.workflows.running.executors import make_executor
from zsmoseg.workflows.running.first_look import make_plan
from zsmoseg.workflows.running.guard import leave_if_imported_again
from zsmoseg.workflows.running.request import Failure, Quiet, Report, Request, Watcher, none_can_run
from zsmoseg.workflows.running.scheduler import check_scheduler
from zsmoseg.workflows.running.workers import Needs

SMALL = 15.0
"""A batch below this many estimated seconds runs in this process: a cluster would take longer to start."""
LOOK = (6, 64)
"""Videos with something to do that are planned before the first is computed: at least, to guess what all take, and at
most, to see whether all are small."""


def found_in(request: Request, note: Callable[[str], None] = lambda line: None) -> list[Named]:
    """The videos that the sources hold, and their names; ``note`` is told what is passed over.

    Raises
    ------
    VideoError
        A source means nothing; two have one name.
    """
    found, passed = without_outputs(sources(request.sources), request.sources)
    if passed:
        note(passed)
    return list(zip(found, unique_names(found), strict=True))


def run(request: Request, watcher: Watcher | None = None) -> Report:
    """Run what is missing.

    Raises
    ------
    ZsmosegError
        Before anything is started: bad sources, settings, store, output folder, too little disk, no cluster.
    """
    check_scheduler(request.scheduler)
    if request.scheduler == "local":
        leave_if_imported_again()
    watcher = watcher or Quiet()
    with system_errors_in_words():
        place, _ = files.folder(request.store), files.folder(request.out)
        with one_look():
            found = found_in(request, watcher.note)
        report = Report()
        store = Store.open(place, create=True)
        try:
            return _run(request, store, found, report, watcher)
        except ZsmosegError:
            if not report.started:
                store.unmake(report.run)
            raise


def _run(request: Request, store: Store, found: Sequence[Named], report: Report, watcher: Watcher) -> Report:
    meant = choose(found, request.choice, store, request.out)
    report.names = [name for _, name in meant]
    if not meant:
        watcher.note(nothing_left(len(found), request.choice))
        return report
    batch = Batch(request, store, meant, len(found) == 1, report, watcher)
    outcome = INTERRUPTED
    try:
        _compute(batch)
        outcome = FAILED if report.failures else DONE
    finally:
        batch.end(outcome)
        batch.rates.keep()
    return report


def _compute(batch: Batch) -> None:
    """Plan the first videos, choose who computes, hand all to it."""
    request = batch.request
    first, guess, small = _look(batch)
    kind, workers = _who(request, first, small)
    batch.watcher.estimated(_lasting(guess, kind, workers, batch.rates))
    if not first:
        return
    executor = make_executor(kind, workers, _needs(batch, first), request.patience, batch.watcher.note)
    entered = False
    try:
        began = time.perf_counter()
        with executor:
            entered, start = True, time.perf_counter() - began
            drive = Drive(executor, batch, first)
            drive.run()
            paid = (time.perf_counter() - began - start) * executor.slots
        if isinstance(kind, str):
            batch.rates.used(kind, start, drive.useful, paid)
    except ZsmosegError as error:
        if not entered or not batch.report.started:
            raise
        batch.abandon(error)


def _who(request: Request, first: Sequence[VideoPlan], small: bool) -> tuple[Any, int | None]:
    """The executor, and its workers as far as we choose them."""
    if request.scheduler == "local" and not small:
        return "local", request.workers or fitting_workers(first)
    return "serial" if request.scheduler == "local" else request.scheduler, request.workers


def _lasting(guess: Estimate, kind: Any, workers: int | None, rates: Rates) -> Estimate:
    """With the seconds to the end, where it is known who computes."""
    if kind not in ("serial", "local"):
        return guess
    return guess.with_workers(workers or 1 if kind == "local" else 1, rates.use(kind))


def _look(batch: Batch) -> tuple[deque[VideoPlan], Estimate, bool]:
    """The first videos with something to do, what all take, and whether these are all, and small."""
    first, guess = deque[VideoPlan](), batch.guess([])
    while plan := batch.take():
        first.append(plan)
        guess += batch.guess([plan])
        if len(first) >= LOOK[1] or (len(first) >= LOOK[0] and guess.seconds >= SMALL):
            break
    videos = len(batch.report.names)
    refuse_full_disk(batch.request.store, guess)
    if batch.request.scheduler in ("local", "serial") and any(models_of(first)):
        chosen_provider(batch.request.settings.networks.provider)
    return first, guess.of(batch.looked, videos), batch.looked == videos and guess.seconds < SMALL


def _needs(batch: Batch, first: deque[VideoPlan]) -> Needs:
    """What workers must see: the sources of the first videos stand for all."""
    assert batch.record is not None
    outs = [batch.request.out] if any(plan.files for plan in first) else []
    for out in outs:
        files.make_folder(out)
    return Needs.of(
        files.absolute(batch.store.path),
        files.absolute(batch.record.path),
        [plan.probe.source for plan in first],
        [files.absolute(out) for out in outs],
    )


def each_plan(
    request: Request, store: Store, found: Sequence[Named]
) -> Iterator[tuple[str, VideoPlan | Failure]]:
    """The plan of every video of ``found`` that is meant, or what is wrong with it; nothing is written.

    Raises
    ------
    ZsmosegError
        Of a single video, why it cannot be planned.
    """
    meant = choose(found, request.choice, store, request.out)
    for source, name in meant:
        try:
            yield name, make_plan(request, store, source, name, len(found) == 1)
        except Exception as error:
            if len(meant) == 1:
                raise
            yield name, Failure.of(error, source)


def dry_run(request: Request) -> Iterator[str]:
    """The plan in words, video by video; nothing is written.

    Raises
    ------
    ZsmosegError
        Of a single video, why it cannot be planned; of several not one can be.
    """
    check_scheduler(request.scheduler)
    with system_errors_in_words():
        store = Store(files.folder(request.store))
        if files.exists(store.path):
            store = Store.open(request.store, create=False)
        passed = list[str]()
        found = found_in(request, passed.append)
        yield from passed
        if not choose(found, request.choice, store, request.out):
            yield nothing_left(len(found), request.choice)
            return
        rates, plans, failures = Rates.load(), list[VideoPlan](), list[Failure]()
        guess = estimate([], rates)
        for name, plan in each_plan(request, store, found):
            if isinstance(plan, Failure):
                yield f"{name}: {plan.message}"
                failures.append(plan)
                continue
            guess += estimate([plan], rates)
            plans = [*plans[: LOOK[0]], plan]
            yield from explain_plan([plan])
        if not plans:
            raise none_can_run(failures)
        kind, workers = _who(request, plans, guess.seconds < SMALL)
        yield from estimate_lines(_lasting(guess, kind, workers, rates))
