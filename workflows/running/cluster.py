"""Jobs on Dask: on a cluster of this machine or anybody's; every state that a cluster can be in has words and an end."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Self

from zsmoseg.errors import ClusterError
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.deadlines import STARTING, Deadlines
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.running.local_cluster import CLOSING, start
from zsmoseg.workflows.running.request import PATIENCE
from zsmoseg.workflows.running.scheduler import CONNECT, TICK, connect
from zsmoseg.workflows.running.whole import Ordered, all_failed, run_jobs
from zsmoseg.workflows.running.workers import Needs, problems, refuse, within

GPU = "GPU"
"""The resource of Dask workers with a GPU (``dask worker --resources GPU=1``): where some have it, networks run there."""
LOOK = 5.0
"""Seconds from one look at the cluster to the next while results come."""
LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")
"""They print tracebacks of what the run says in a line. Dask gives some of them a level of their own when it is imported."""
AGAIN = "what was finished is kept; mend the cluster and run the same command again"


class Dask:
    """``client.submit`` with explicit futures: one task a part, named, with priority.

    Parameters
    ----------
    where
        ``"local"`` (a cluster of one-thread processes on this machine), the address of a scheduler, a scheduler
        file, or a ``distributed.Client``.
    needs
        What workers of others must see; None: they are not asked.
    patience
        Seconds without a worker that could do what is left, after which the run gives up.
    say
        Takes a line about what is waited for.
    """

    def __init__(
        self,
        where: Any = "local",
        workers: int | None = None,
        needs: Needs | None = None,
        patience: float = PATIENCE,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._where, self._workers, self._needs = where, workers, needs
        self._patience, self._say = patience, say
        self._futures: dict[str, Any] = {}
        self._open: dict[str, bool] = {}  # names of jobs without result yet: whether a GPU must run them
        self._whole: dict[str, Ordered] = {}  # jobs that are one task, by the name of the first
        self._limits: dict[str, float] = {}  # seconds that each has, by key
        self._deadlines, self._late = Deadlines(say), dict[str, Outcome]()
        self._came: SimpleQueue[str] = SimpleQueue()
        self._cluster: Any = None
        self._client: Any = None
        self._stack = ExitStack()
        self._run = os.urandom(4).hex()
        self._gpu, self.slots = False, 1
        self._lost: list[str] = []
        self._known: set[str] = set()
        self._empty_since: float | None = None
        self._told = False
        self._looked = 0.0
        # workers of others have a thread a task; ours share the cores of this machine
        self.threads = max(1, cores(None) // cores(workers)) if where == "local" else 1

    # ------------------------------------------------------------------ in and out
    def __enter__(self) -> Self:
        _silence(logging.CRITICAL)
        try:
            self._connect()
            self._assemble()
        except BaseException as error:
            self.__exit__(type(error), error, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _silence(logging.CRITICAL + 1)
        left, self._futures = list(self._futures.values()), {}
        if self._client is not None:
            if kind is not None and left:
                _quietly(lambda: self._client.cancel(left, force=True))
            if self._client is not self._where:
                _quietly(lambda: self._client.close(timeout=CLOSING))
        if self._cluster is not None:
            _quietly(lambda: self._cluster.close(timeout=CLOSING))
        self._stack.close()

    def _connect(self) -> None:
        if self._where == "local":
            from distributed import Client

            self._cluster = start(self._workers, self._stack)
            self._client = Client(self._cluster)
        elif isinstance(self._where, str):
            self._client = connect(self._where, self._patience, self._wait)
        else:
            self._client = self._where

    # ------------------------------------------------------------------ workers
    def _assemble(self) -> None:
        """Wait for a first worker; adaptive clusters start one when a task waits. Look at those that are there."""
        if not self._present():
            hello = self._client.submit(len, (), key=f"zsmoseg-hello-{self._run}", pure=False)
            begun = time.monotonic()
            while not self._present():
                self._wait(begun, f"workers of {self._name}", "start workers")
                time.sleep(TICK)
            hello.release()
        self._watch(self._present() or {})

    def _present(self) -> dict[str, Any] | None:
        """The workers by address, as the scheduler sees them; None where it does not answer, as when it is busy."""
        if self._client.status != "running":
            raise ClusterError(f"the scheduler of {self._name} is gone; {AGAIN}")
        try:
            info = within(CONNECT, lambda: self._client.scheduler_info(n_workers=-1))
        except (ClusterError, OSError):
            return None
        found: dict[str, Any] = info["workers"]
        return found

    @property
    def _name(self) -> str:
        if self._where == "local":
            return "the local cluster"
        return self._where if isinstance(self._where, str) else str(self._client.scheduler.address)

    def _wait(self, begun: float, what: str, cure: str) -> None:
        """Say once what is waited for; give up when patience is at an end."""
        waited = time.monotonic() - begun
        if waited > self._patience:
            self._told = False
            raise ClusterError(
                f"no {what} for {waited:.0f} s; {cure} and run the same command again, what was finished is kept "
                "(--patience SECONDS waits longer)"
            )
        if not self._told:
            self._told = True
            self._say(f"waiting for {what} ({self._patience:.0f} s at most, --patience)")

    def _watch(self, present: dict[str, Any] | None) -> None:
        """Look at workers that are new, start those of ours that died, wait for what lacks."""
        self._looked = time.monotonic()
        if present is None:
            self._lacks(f"answer of the scheduler of {self._name}", "look what it does")
            return
        self._look_at_new(present)
        self.slots = max(1, sum(worker["nthreads"] for worker in present.values()))
        with_gpu = {address for address, worker in present.items() if GPU in worker["resources"]}
        self._gpu = bool(with_gpu) or self._gpu
        if self._cluster is not None and len(present) < cores(self._workers):
            self._cluster.scale(
                cores(self._workers)
            )  # nannies that were killed too do not come back by themselves
        if not present:
            self._lacks(f"workers of {self._name}", "start workers")
        elif any(self._open.values()) and not with_gpu:
            self._lacks(f"workers of {self._name} with a GPU (--resources GPU=1)", "start workers")
        else:
            self._empty_since, self._told = None, False

    def _lacks(self, what: str, cure: str) -> None:
        self._empty_since = self._empty_since or self._looked
        self._wait(self._empty_since, what, cure)

    def _look_at_new(self, present: dict[str, Any]) -> None:
        new, first = present.keys() - self._known, not self._known
        self._known |= new
        if not new or self._needs is None:
            return
        try:
            found = problems(self._client, sorted(new), self._needs)
        except ClusterError as error:
            if first:
                raise ClusterError(f"the workers of {self._name} do not answer: {error}; {AGAIN}") from error
            return  # they came and went
        refuse(found, present)

    # ------------------------------------------------------------------ jobs
    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Submit one job; what it reads are its dependencies."""
        self._submit(job, priority, run_job, job, *(self._futures[name] for name in before))

    def submit_whole(self, jobs: Ordered, priority: int) -> None:
        """One task, by the name of its first job."""
        first, _ = jobs[0]
        self._whole[first.name] = jobs
        self._submit(first, priority, run_jobs, jobs)

    def _submit(self, job: Job, priority: int, *call: Any) -> None:
        gpu = job.network and self._gpu
        try:
            future = self._client.submit(
                *call,
                key=f"{job.name}-{self._run}",
                priority=priority,
                pure=False,
                resources={GPU: 1} if gpu else None,
            )
        except Exception as error:
            if self._client.status == "running":
                raise
            raise ClusterError(f"the scheduler of {self._name} is gone; {AGAIN}") from error
        self._futures[job.name] = future
        self._open[job.name] = gpu
        self._limits[f"{job.name}-{self._run}"] = job.deadline
        self._notify(job.name)

    def _notify(self, name: str) -> None:
        """Put ``name`` among what came as soon as its future has ended in any way."""
        came = self._came
        self._futures[name].add_done_callback(lambda _: came.put(name))

    def results(self) -> Iterator[tuple[str, Outcome]]:
        """Outcomes as they come, with a look at the cluster every few seconds."""
        while self._open:
            try:
                name = self._came.get(timeout=TICK)
            except Empty:
                self._look(TICK)
                continue
            if name not in self._open:  # one that ran over, and was dropped
                continue
            outcome = self._outcome(name)
            if outcome is not None:
                del self._open[name]
                del self._limits[f"{name}-{self._run}"]
                self._empty_since = None
                yield from outcome.items()
            self._look(LOOK)

    def _look(self, every: float) -> None:
        if time.monotonic() - self._looked < every:
            return
        present = self._present()
        self._watch(present)
        if present is not None:  # who does not answer need not be asked for more
            self._drop_late()
        while self._lost:
            self._notify(self._lost.pop())

    def _drop_late(self) -> None:
        """Workers whose task runs over start anew; a task that did once too often failed."""
        try:
            late = within(
                2 * CONNECT + STARTING,
                lambda: self._deadlines.look(self._client, self._limits, self._take_back),
            )
        except Exception:  # whatever Dask raises when it is in trouble: the next look says what is wrong
            return
        self._late |= {key.removesuffix(f"-{self._run}"): outcome for key, outcome in late.items()}

    def _take_back(self, key: str) -> None:
        """A task by its key; its name comes among what ended."""
        self._futures[key.removesuffix(f"-{self._run}")].cancel(force=True)

    def _outcome(self, name: str) -> dict[str, Outcome] | None:
        """What became of a job, or of those that were one task with it; None where its result was lost with a worker, and comes again."""
        from distributed import CancelledError
        from distributed import TimeoutError as Late

        future = self._futures[name]
        if name in self._late:
            outcome = self._late.pop(name)
            return all_failed(self._whole.pop(name), outcome) if name in self._whole else {name: outcome}
        if future.status == "cancelled":
            raise ClusterError(
                f"{self._name} dropped the work: its scheduler is gone or was restarted; {AGAIN}"
            )
        if future.status == "error":
            return self._died(name, future.exception())
        try:
            if future.status == "finished":
                left = future.result(timeout=LOOK)
                return left if self._whole.pop(name, None) else {name: left}
        except (Late, CancelledError):
            pass
        except Exception as error:
            return self._died(name, error)
        self._lost.append(name)
        return None

    def _died(self, name: str, error: BaseException) -> dict[str, Outcome]:
        outcome = Outcome("failed", error=_death(error))
        return all_failed(self._whole.pop(name), outcome) if name in self._whole else {name: outcome}

    def release(self, names: Sequence[str]) -> None:
        """Let the scheduler forget."""
        for name in names:
            future = self._futures.pop(name, None)
            if future is not None:
                future.release()


def _death(error: BaseException) -> str:
    return (
        f"{type(error).__name__}: the worker died again and again, most often of too little memory; "
        "use fewer workers (--workers) or a smaller chunk.length"
        if type(error).__name__ == "KilledWorker"
        else f"{type(error).__name__}: {error}"
    )


def _silence(level: int) -> None:
    import distributed  # noqa: F401

    for name in LOGGERS:
        logging.getLogger(name).setLevel(level)


def _quietly(close: Callable[[], Any]) -> None:
    """Close something that may be gone already; not for longer than it is worth."""
    with suppress(Exception):
        within(2 * CLOSING, close)
