"""A Dask cluster on this machine: processes of one thread, listening here only, with the allocator set before they start."""

from __future__ import annotations

import logging
import signal
import threading
from contextlib import ExitStack
from typing import Any

from zsmoseg.errors import ClusterError
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.guard import refuse_unguarded

ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
"""Bytes, for glibc. Dask's 64 KiB gives every image-sized array back to the system at once, and the next one faults its
pages in anew (benchmarks/allocator.py); 32 MiB is the most that every glibc takes for the second."""


def start(workers: int | None, stack: ExitStack) -> Any:
    """Start it; ``stack`` puts Dask's configuration back. Ctrl-C is ours, not theirs.

    Raises
    ------
    ClusterError
        If the workers do not come up, or the script that starts them has no guard.
    """
    import dask
    from distributed import LocalCluster

    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if _main_thread() else None
    stack.enter_context(dask.config.set(configuration()))  # workers that are started again read it too
    try:
        refuse_unguarded()
        made = LocalCluster(
            n_workers=cores(workers),
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
        made.shutdown_on_close = (
            False  # we close it; at exit Dask would try once more, and print what Ctrl-C does to that
        )
        return made
    except ClusterError:
        raise
    except Exception as error:
        raise ClusterError(
            f"the local cluster did not start ({' '.join(str(error).split()) or type(error).__name__}): a worker died "
            "on the way; use fewer --workers where memory is short, or --scheduler serial"
        ) from error
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


def configuration() -> dict[str, Any]:
    """What differs from Dask's defaults; variables that the user has set win over what stands here."""
    import dask

    environment = "distributed.nanny.pre-spawn-environ"
    return {
        "distributed.worker.profile.enabled": False,
        environment: {**dask.config.get(environment), **ALLOCATOR},
    }


def _main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
