"""The videos of a run, one after another: planned when there is room, laid out, finished, forgotten."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from zsmoseg.errors import AccessError, StoreError, ZsmosegError, in_words, stops_all
from zsmoseg.stores import files, seen
from zsmoseg.stores.imports import remember
from zsmoseg.stores.leases import lease
from zsmoseg.stores.location import MARK, Store
from zsmoseg.stores.runs import DONE, FAILED, RUNNING, Entry, RunRecord
from zsmoseg.stores.upkeep import give_up
from zsmoseg.workflows.planning.estimate import Estimate, estimate, refuse_full_disk
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.planning.rates import Rates, Taken, kept_work
from zsmoseg.workflows.running.artifacts import prepare, seal_video
from zsmoseg.workflows.running.choosing import Named
from zsmoseg.workflows.running.first_look import make_plan
from zsmoseg.workflows.running.request import KEPT, Failure, Report, Request, Watcher, none_can_run


class Batch:
    """All videos of a run. What is kept of one that is through are its name and how it ended.

    Parameters
    ----------
    meant
        Sources and names, in the order in which they are worked on.
    alone
        The sources hold one video.
    """

    def __init__(
        self,
        request: Request,
        store: Store,
        meant: Sequence[Named],
        alone: bool,
        report: Report,
        watcher: Watcher,
    ) -> None:
        self.request, self.store, self.report, self.watcher = request, store, report, watcher
        self.record: RunRecord | None = None
        self.rates = Rates.load()
        self._alone, self._size = alone, len(meant)
        self._sources = [source for source, _ in meant]
        self._coming = deque(meant)
        self._held: dict[str, Callable[[], bool]] = {}  # by name: whether what it waits for goes on
        self._leases: dict[str, ExitStack] = {}
        self._working: dict[str, VideoPlan] = {}
        self._unheard: dict[str, Failure] = {}
        self._loose: dict[str, Failure] = {}

    # ------------------------------------------------------------------ planning
    @property
    def looked(self) -> int:
        """Videos that were looked at so far."""
        return self._size - len(self._coming)

    def take(self) -> VideoPlan | None:
        """The plan of the next video with something to do, if there is one now; those without are finished on the way.

        Raises
        ------
        SpaceError
            It will not fit on the disk.
        ZsmosegError
            See ``fail``; not one video can be planned.
        """
        plan = self._next()
        while plan is None and self._coming and not self._working:
            self._wait()
            plan = self._next()
        if self.record is None and self._unheard:
            raise none_can_run(list(self._unheard.values()))
        return plan

    def _next(self) -> VideoPlan | None:
        """The next one that nobody works on."""
        for _ in range(len(self._coming)):
            source, name = self._coming.popleft()
            if name in self._held and self._held[name]():
                self._coming.append((source, name))
                continue
            self._held.pop(name, None)
            plan = self._free(source, name)
            if plan is not None and self._is_to_do(plan):
                return plan
        return None

    def _is_to_do(self, plan: VideoPlan) -> bool:
        """Whether there is something to compute; what has nothing is finished."""
        self.watcher.planned(plan)
        self.report.planned.add(plan.name)
        self._working[plan.fingerprint] = plan
        if plan.settled is not None:
            self.report.started = True
            self.finish(plan)
        elif plan.todo:
            refuse_full_disk(self.request.store, self.guess([plan]))
        elif self.begin(plan):
            self.finish(plan)
        return bool(plan.todo)

    def _free(self, source: str, name: str) -> VideoPlan | None:
        """The plan of a video that nobody works on; others come again at the end."""
        plan = self._plan(source, name)
        if plan is None:
            return None
        self._begin_run()
        if plan.fingerprint in self._working:
            # another name for the same content: what that leaves is not computed twice
            content = plan.fingerprint
            self._hold_back(source, name, lambda: content in self._working)
            return None
        if plan.files and plan.settled is None and name not in self._leases:
            try:
                before = plan.output.stamp
                if not self._lease(plan, wait=False):
                    path = plan.output.lease
                    self._hold_back(source, name, lambda: files.exists(path))
                    return None
            except (OSError, ZsmosegError) as error:
                if isinstance(error, PermissionError) and not files.exists(plan.output.path):
                    self._refuse_closed(error)
                self.fail(plan, Failure.of(error, source), error)
                return None
            if plan.output.stamp != before:  # another run has written there meanwhile
                plan = self._plan(source, name)
                if plan is None:
                    self._let_go(name)
        return plan

    def _refuse_closed(self, error: PermissionError) -> None:
        """Before anything is started: no other video would get a folder in what is closed either."""
        if not self.report.started:
            raise AccessError(
                f"{self.request.out}: no folder can be made there ({error.strerror}); give another with -o, or mend that"
            ) from error

    def _hold_back(self, source: str, name: str, busy: Callable[[], bool]) -> None:
        self._held[name] = busy
        self._coming.append((source, name))

    def _lease(self, plan: VideoPlan, wait: bool) -> bool:
        """Whether nobody else works on the output folder of a video until it is through."""
        stack = ExitStack()
        if not stack.enter_context(lease(plan.output.lease, wait=wait, steal=self.request.steal)):
            stack.close()
            return False
        self._leases[plan.name] = stack
        return True

    def _wait(self) -> None:
        """Nothing is left but what other runs work on: wait for the first of it; what is missing then is ours."""
        source, name = self._coming.popleft()
        plan = self._plan(source, name)
        if plan is None:
            return
        self.watcher.note(f"waiting for another run that works on {plan.output.path}")
        try:
            self._lease(plan, wait=True)
        except (OSError, ZsmosegError) as error:
            self.fail(plan, Failure.of(error, source), error)
            return
        self._held.pop(name, None)
        self._coming.appendleft((source, name))

    def _plan(self, source: str, name: str) -> VideoPlan | None:
        try:
            return make_plan(self.request, self.store, source, name, self._alone)
        except Exception as error:
            if stops_all(error) or (self._size == 1 and isinstance(error, ZsmosegError)):
                raise
            self._unheard[name] = Failure.of(error, source)
        if self.record is not None:
            self._tell()
        return None

    def _begin_run(self) -> None:
        """Note the run once a video of it can be planned, and what became of those before."""
        if self.record is None:
            settings, out = self.request.settings.flat(), files.absolute(self.request.out)
            self.record = RunRecord.begin(self.store, settings, self.report.names, self._sources, out)
            self.store.mark()
            self.report.run = self.record.id
        self._tell()

    def _tell(self) -> None:
        for name, failure in self._unheard.items():
            self._loose[name] = failure
            self.report.fail(name, failure, self.watcher)
        self._unheard.clear()

    def guess(self, plans: Sequence[VideoPlan]) -> Estimate:
        """What these take."""
        return estimate(plans, self.rates)

    # ------------------------------------------------------------------ one video
    def begin(self, plan: VideoPlan) -> bool:
        """Lay a video out; whether that went well."""
        self._refuse_no_store()
        try:
            self.store.describe_video(plan.video, plan.source, plan.fingerprint)
            if plan.todo:
                self._note(plan, RUNNING)
            prepare(self.store, plan)
        except Exception as error:
            self.fail(plan, Failure.of(error, plan.source), error)
            return False
        self.report.started = True
        return True

    def finish(self, plan: VideoPlan) -> None:
        """Seal what is complete; clear and describe the output folder."""
        try:
            if plan.settled is not None:
                summary = plan.settled or None
                self._done(plan)
            else:
                with files.looking_at(self.store.video(plan.video).path, plan.output.path):
                    summary = seal_video(plan, self.request.settings)
                    plan.seen = self._seen(plan)
                    self._done(plan)
        except Exception as error:
            self.fail(plan, Failure.of(error, plan.source), error)
            return
        self._leave(plan)
        self._count(plan, summary)
        self.report.finish(plan.name, summary)
        self.watcher.finished(plan, summary)

    def _done(self, plan: VideoPlan) -> None:
        if self.request.imports:
            remember(self.store, plan.video, plan.brought, plan.keys)
            plan.imported |= plan.brought.keys()
        self._note(plan, DONE)

    def _count(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """Keep what the artifacts that were computed take on the disk, for estimates to come."""
        if plan.settled is None and summary is not None:
            for name, took in summary["stages"].items():
                stage = plan.stages[name]
                size, frames = took["megabytes"] * 1e6, len(plan.probe.times)
                self.rates.sized(stage, Taken(size=size, kept=kept_work(plan, stage, frames)))

    def fail(self, plan: VideoPlan, failure: Failure, error: Exception | None = None) -> None:
        """Note that a video failed, by ``error`` if the client saw it.

        Raises
        ------
        ZsmosegError
            It is no affair of this video: the disk is full or read-only, the store is gone.
        """
        if error is not None and stops_all(error):
            raise error if isinstance(error, ZsmosegError) else AccessError(failure.message) from error
        self._refuse_no_store()
        self._fail(plan, failure)

    def _refuse_no_store(self) -> None:
        """A store that vanished is not made anew piece by piece: it may lie on a disk that is not mounted."""
        if not files.exists(self.store.path / MARK):
            raise StoreError(
                f"{self.store.path}: the store is gone; bring it back and run the same command again"
            )

    def _fail(self, plan: VideoPlan, failure: Failure) -> None:
        self._leave(plan)
        try:
            self._refuse_no_store()
            self._note(plan, FAILED, failure)
        except (OSError, ZsmosegError):
            self._loose[plan.name] = failure
        self.report.fail(plan.name, failure, self.watcher)

    def _leave(self, plan: VideoPlan) -> None:
        """Others may work on it."""
        self._working.pop(plan.fingerprint, None)
        self._let_go(plan.name)

    def _let_go(self, name: str) -> None:
        self._leases.pop(name, ExitStack()).close()

    def _note(self, plan: VideoPlan, outcome: str, failure: Failure | None = None) -> None:
        assert self.record is not None
        entry = Entry(
            self.record.id,
            plan.name,
            plan.video,
            plan.source,
            files.absolute(plan.output.path) if plan.files else "",
            plan.graph,
            plan.keys,
            outcome,
            seen=plan.seen if outcome == DONE else {},
            dropped=self._dropped(plan, outcome),
            imported=" ".join(sorted(plan.imported)),
        )
        self.record.note(replace(entry, failure=failure.message, trace=failure.trace) if failure else entry)
        if outcome == DONE and entry.dropped:
            give_up(self.store, entry)

    def _dropped(self, plan: VideoPlan, outcome: str) -> str:
        """The stages whose artifacts a video does without, once it is finished or before."""
        artifacts = {name: stage for name, stage in plan.stages.items() if stage.artifact is not None}
        kept = (
            {*artifacts}
            if outcome != DONE
            else {*KEPT.get(self.request.keep, artifacts), *self.request.until}
        )
        return " ".join(n for n, stage in artifacts.items() if n not in kept or plan.lacks(stage))

    def _seen(self, plan: VideoPlan) -> dict[str, str]:
        """How its artifacts are."""
        keys = {name: stage.key for name, stage in plan.stages.items() if stage.artifact is not None}
        return seen.look(self.store.video(plan.video).path, keys)

    # ------------------------------------------------------------------ the end
    def abandon(self, error: ZsmosegError) -> None:
        """Nothing goes on: every video that is not finished failed, those that were not begun with one line."""
        failure = Failure(f"not finished: {error}")
        for plan in list(self._working.values()):
            self._fail(plan, failure)
        through = {*self.report.finished, *self.report.failures}
        rest = [name for name in self.report.names if name not in through]
        self.report.failures |= dict.fromkeys(rest, failure.message)
        if rest:
            self.watcher.note(f"{len(rest)} more videos were not begun: {error}")

    def end(self, outcome: str) -> None:
        """Note how the run ended; a store that is full or gone by now keeps what it has."""
        for stack in self._leases.values():
            stack.close()
        if self.record is None:
            return
        failures = {name: failure.message for name, failure in self._loose.items()}
        traces = {name: failure.trace for name, failure in self._loose.items() if failure.trace}
        try:
            self._refuse_no_store()
            self.record.end(outcome, failures, traces)
        except (OSError, ZsmosegError) as error:
            self.watcher.note(f"how the run ended cannot be noted in the store: {in_words(error) or error}")
