"""What a process spends on being ready: functions compiled by Numba, or loaded as they were compiled before."""

from __future__ import annotations

import threading
import time
from functools import cache
from typing import Any

EVENT = "numba:compiler_lock"
"""Held by a thread while it loads or compiles a function."""


class _Compiling(threading.local):
    """Seconds of the processor, and by the clock, that this thread has spent so."""

    depth = 0
    since = 0.0, 0.0
    processor = wall = 0.0


_THREAD = _Compiling()


@cache
def _listen() -> None:
    """Tell Numba once a process."""
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc,unused-ignore]
        def on_start(self, event: Any) -> None:
            if _THREAD.depth == 0:
                _THREAD.since = time.thread_time(), time.perf_counter()
            _THREAD.depth += 1

        def on_end(self, event: Any) -> None:
            _THREAD.depth -= 1
            if _THREAD.depth == 0:
                _THREAD.processor += time.thread_time() - _THREAD.since[0]
                _THREAD.wall += time.perf_counter() - _THREAD.since[1]

    event.register(EVENT, Listener())


class Clock:
    """What a task takes from now on, on its thread, beside what it spends on being ready."""

    def __init__(self) -> None:
        _listen()
        self._processor, self._wall = time.process_time(), time.perf_counter()
        self._ready = _THREAD.processor, _THREAD.wall

    def taken(self, opening: float = 0.0) -> tuple[float, float, float]:
        """Seconds of the processor and by the clock without those of being ready; the latter, of the processor.

        Parameters
        ----------
        opening
            Seconds that went into opening networks.
        """
        processor, wall = (
            opening + now - before
            for now, before in zip((_THREAD.processor, _THREAD.wall), self._ready, strict=True)
        )
        return (
            max(time.process_time() - self._processor - processor, 0.0),
            max(time.perf_counter() - self._wall - wall, 0.0),
            processor,
        )
