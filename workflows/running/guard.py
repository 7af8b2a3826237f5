"""Processes that are started load the script of the one that starts them, and are not meant by its Ctrl-C."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import current_process, get_context

from zsmoseg.errors import ClusterError

UNGUARDED = 75
"""Exit code of a process that was about to start what started it."""


def leave_if_imported_again() -> None:
    """End this process, without a word, where it is one that loads the script of the process that starts it."""
    if getattr(current_process(), "_inheriting", False):  # what multiprocessing itself asks
        raise SystemExit(UNGUARDED)


def refuse_unguarded() -> None:
    """Start one process that does nothing, to see whether more can be started.

    Raises
    ------
    ClusterError
        The script has no guard, or cannot be loaded again.
    """
    leave_if_imported_again()
    trial = get_context("spawn").Process(target=_nothing)
    with unheard():
        trial.start()
    try:
        trial.join()
    except BaseException:
        trial.kill()
        raise
    if not trial.exitcode:
        return
    script = getattr(sys.modules["__main__"], "__file__", None) or "this program"
    if trial.exitcode != UNGUARDED:
        raise ClusterError(
            f"{script}: cannot be loaded by the processes that it starts (exit code {trial.exitcode}); mend that, or do "
            "all in this process: scheduler='serial', or workers=1 of evaluate"
        )
    raise ClusterError(
        f"{script}: starts processes, and each of them loads it again; put what it does below if __name__ == '__main__':, "
        "or do all in this process: scheduler='serial', or workers=1 of evaluate"
    )


@contextmanager
def unheard() -> Iterator[None]:
    """Processes that are started within do not hear Ctrl-C; this one hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _nothing() -> None:
    """The script is loaded by now."""
