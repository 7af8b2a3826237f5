"""Where jobs run: a loop in this process, or Dask. One face, the same functions, the same bytes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

from zsmoseg.errors import SettingsError
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.cluster import Dask
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.running.request import PATIENCE
from zsmoseg.workflows.running.whole import Ordered
from zsmoseg.workflows.running.workers import Needs


class Executor(Protocol):
    """Takes jobs with the names of the jobs before them; yields what became of each.

    Attributes
    ----------
    threads
        That one task may use within a network.
    slots
        Tasks that run at once, as far as is known.
    """

    threads: int
    slots: int

    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Queue a job behind those named in ``before``."""

    def submit_whole(self, jobs: Ordered, priority: int) -> None:
        """Queue all jobs of a tiny video as one task."""

    def results(self) -> Iterator[tuple[str, Outcome]]:
        """Names and outcomes as they come, until nothing is queued; jobs may be added meanwhile."""

    def release(self, names: Sequence[str]) -> None:
        """Forget jobs that nothing will wait for any more."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Serial:
    """A loop in this process; Dask is not imported."""

    def __init__(self) -> None:
        self.threads, self.slots = cores(None), 1
        self._queue: deque[tuple[Job, Sequence[str]]] = deque()
        self._outcomes: dict[str, Outcome] = {}

    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Jobs run in the order in which they come: each after what it reads."""
        self._queue.append((job, before))

    def submit_whole(self, jobs: Ordered, priority: int) -> None:
        """A task costs nothing here."""
        self._queue.extend(jobs)

    def results(self) -> Iterator[tuple[str, Outcome]]:
        """Run the queue."""
        while self._queue:
            job, before = self._queue.popleft()
            outcome = run_job(job, *(self._outcomes[name] for name in before))
            self._outcomes[job.name] = outcome
            yield job.name, outcome

    def release(self, names: Sequence[str]) -> None:
        """Forget outcomes."""
        for name in names:
            self._outcomes.pop(name, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._queue.clear()


def refuse_no_scheduler(scheduler: Any) -> None:
    """Refuse what cannot be a scheduler, whether or not anything is left to compute.

    Raises
    ------
    SettingsError
        It is neither serial nor local, no address, no file, no client.
    """
    if isinstance(scheduler, str):
        fits = scheduler in ("serial", "local") or ":" in scheduler or scheduler.endswith(".json")
        fits, told = fits or os.path.exists(scheduler), scheduler
    else:
        fits, told = hasattr(scheduler, "scheduler_info"), f"of type {type(scheduler).__name__}"
    if not fits:
        raise SettingsError(
            f"--scheduler {told}: is no scheduler; give local, serial, an address as tcp://host:port or a scheduler file"
        )


def make_executor(
    scheduler: Any,
    workers: int | None = None,
    needs: Needs | None = None,
    patience: float = PATIENCE,
    say: Callable[[str], None] = lambda text: None,
) -> Executor:
    """``serial``, ``local``, an address, a scheduler file, or a Dask client; see ``Dask`` for the rest."""
    if scheduler == "serial":
        return Serial()
    return Dask(scheduler, workers, None if scheduler == "local" else needs, patience, say)
