"""Tasks that run far longer than they should: the worker is named and started anew, and the task tried once more."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from zsmoseg.workflows.running.jobs import Outcome

LEAST = 600.0
"""Seconds that every task has: a network is opened, a disk is busy."""
TIMES = 20.0
"""A task has so many times what it is estimated to take: estimates are of typical figures, machines differ."""
STARTING = 60.0
"""Seconds for workers to start anew."""
TRIES = 2
"""Times that a task may run over before its video fails."""


def deadline(seconds: float) -> float:
    """Seconds that a task has which is estimated to take ``seconds``."""
    return max(LEAST, TIMES * seconds)


def executing(dask_scheduler: Any = None) -> dict[str, tuple[str, float]]:
    """On the scheduler: the worker and the seconds of every task that runs, by key."""
    return {
        str(task.key): (worker.address, float(seconds))
        for worker in dask_scheduler.workers.values()
        for task, seconds in worker.executing.items()
    }


class Deadlines:
    """Which tasks run over.

    Parameters
    ----------
    say
        Takes a line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._over = say, Counter[str]()

    def look(
        self, client: Any, limits: Mapping[str, float], drop: Callable[[str], None]
    ) -> dict[str, Outcome]:
        """Start workers anew whose task runs over; what failed by that once too often, by key.

        Parameters
        ----------
        limits
            Seconds that a task has, by key.
        drop
            Takes a task back by its key: before its worker starts anew, or another one would go on with it.
        """
        import cloudpickle  # type: ignore[import-untyped,unused-ignore]

        # a scheduler need not have zsmoseg: the function goes there as it is
        cloudpickle.register_pickle_by_value(sys.modules[__name__])
        try:
            running = client.run_on_scheduler(executing)
        finally:
            cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
        failed, slow = {}, []
        for key, (worker, seconds) in running.items():
            if seconds <= limits.get(key, seconds):
                continue
            self._over[key] += 1
            slow.append(worker)
            what = f"runs since {seconds:.0f} s on {worker}, it had {limits[key]:.0f} s"
            if self._over[key] >= TRIES:
                failed[key] = Outcome(
                    "failed", error=f"{what}, {TRIES} times; look at that machine and its disk"
                )
                drop(key)
            self._say(f"{key.rpartition('-')[0]}: {what}; its worker is started anew")
        if slow:
            client.restart_workers(sorted(set(slow)), timeout=STARTING, raise_for_error=False)
        return failed
