"""Where jobs run: a loop in this process, or Dask. One face, the same functions, the same bytes."""

from __future__ import annotations

import logging
import os
import signal
from collections import deque
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Protocol, Self

from zsmoseg.errors import SettingsError
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job

GPU = "GPU"
"""The resource of Dask workers with a GPU (``dask worker --resources GPU=1``): where some have it, networks run there."""


class Executor(Protocol):
    """Takes jobs with the names of the jobs before them; yields what became of each.

    Attributes
    ----------
    threads
        That one task may use within a network.
    """

    threads: int

    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Queue a job behind those named in ``before``."""

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
        self.threads = cores(None)
        self._queue: deque[tuple[Job, Sequence[str]]] = deque()
        self._outcomes: dict[str, Outcome] = {}

    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Jobs run in the order in which they come: each after what it reads."""
        self._queue.append((job, before))

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


class Dask:
    """``client.submit`` with explicit futures: one task a part, named, with priority.

    ``where`` is ``"local"`` (a cluster of one-thread processes on this machine), the address of a
    scheduler, a scheduler file, or a ``distributed.Client``.
    """

    def __init__(self, where: Any = "local", workers: int | None = None) -> None:
        self._where, self._workers = where, workers
        self._futures: dict[str, Any] = {}
        self._cluster: Any = None
        self._client: Any = None
        self._run = os.urandom(4).hex()
        self._gpu = False
        # workers of others have a thread a task; ours share the cores of this machine
        self.threads = max(1, cores(None) // cores(workers)) if where == "local" else 1

    def __enter__(self) -> Self:
        from distributed import Client, as_completed

        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        if self._where == "local":
            self._cluster = _local_cluster(self._workers)
            self._client = Client(self._cluster)
        elif isinstance(self._where, str):
            try:
                file = (
                    {"scheduler_file": self._where}
                    if os.path.exists(self._where)
                    else {"address": self._where}
                )
                self._client = Client(**file, timeout="10s")
            except (OSError, ValueError) as error:
                raise SettingsError(
                    f"--scheduler {self._where}: no Dask scheduler answers there ({error}); "
                    "give local, serial, an address or a scheduler file"
                ) from error
        else:
            self._client = self._where
        self._completed = as_completed([])
        there = self._client.scheduler_info(n_workers=-1)["workers"].values()
        self._gpu = any(GPU in worker["resources"] for worker in there)
        return self

    def submit(self, job: Job, before: Sequence[str], priority: int) -> None:
        """Submit one job; what it reads are its dependencies."""
        future = self._client.submit(
            run_job,
            job,
            *(self._futures[name] for name in before),
            key=f"{job.name}-{self._run}",
            priority=priority,
            pure=False,
            resources={GPU: 1} if job.network and self._gpu else None,
        )
        self._futures[job.name] = future
        self._completed.add(future)

    def results(self) -> Iterator[tuple[str, Outcome]]:
        """Outcomes as they come."""
        suffix = len(self._run) + 1
        for future in self._completed:
            error = future.exception()
            outcome = future.result() if error is None else Outcome("failed", error=_death(error))
            yield future.key[:-suffix], outcome

    def release(self, names: Sequence[str]) -> None:
        """Let the scheduler forget."""
        for name in names:
            future = self._futures.pop(name, None)
            if future is not None:
                future.release()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        if kind is not None:
            self._client.cancel(list(self._futures.values()), force=True)
        self._futures.clear()
        if self._client is not self._where:
            self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def _death(error: BaseException) -> str:
    return (
        f"{type(error).__name__}: the worker died again and again, most often of too little memory; "
        "use fewer workers (--workers) or a smaller chunk.length"
        if type(error).__name__ == "KilledWorker"
        else f"{type(error).__name__}: {error}"
    )


def _local_cluster(workers: int | None) -> Any:
    """One-thread processes, listening on this machine only; Ctrl-C is ours, not theirs."""
    import dask
    from distributed import LocalCluster

    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if _main_thread() else None
    try:
        with dask.config.set({"distributed.worker.profile.enabled": False}):
            return LocalCluster(
                n_workers=cores(workers),
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _main_thread() -> bool:
    import threading

    return threading.current_thread() is threading.main_thread()


def make_executor(scheduler: Any, workers: int | None = None) -> Executor:
    """``serial``, ``local``, an address, a scheduler file, or a Dask client."""
    return Serial() if scheduler == "serial" else Dask(scheduler, workers)
