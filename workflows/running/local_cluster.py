"""A Dask cluster on this machine: processes of one thread, listening here only, with the allocator set before they start."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from typing import Any

from zsmoseg.errors import ClusterError
from zsmoseg.workflows.planning.estimate import cores
from zsmoseg.workflows.running.guard import refuse_unguarded, unheard

ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
"""Bytes, for glibc. Dask's 64 KiB gives every image-sized array back to the system at once, and the next one faults its
pages in anew (benchmarks/allocator.py); 32 MiB is the most that every glibc takes for the second."""
CLOSING = 5.0
"""Seconds to let go of a cluster that may be gone."""


def start(workers: int | None, stack: ExitStack) -> Any:
    """Start it; ``stack`` puts Dask's configuration back. Ctrl-C is ours, not theirs.

    Raises
    ------
    ClusterError
        If the workers do not come up, or the script that starts them has no guard.
    """
    import dask
    from distributed import LocalCluster

    stack.enter_context(dask.config.set(configuration()))  # workers that are started again read it too
    refuse_unguarded()
    made = None
    try:
        with unheard():
            made = LocalCluster(
                n_workers=cores(workers),
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            # we close it; at exit Dask would try once more, and print what Ctrl-C does to that
            made.shutdown_on_close = False
        return made
    except Exception as error:
        raise ClusterError(
            f"the local cluster did not start ({' '.join(str(error).split()) or type(error).__name__}): a worker died "
            "on the way; use fewer --workers where memory is short, or --scheduler serial"
        ) from error
    except BaseException:  # Ctrl-C while it started
        if made is not None:
            made.close(timeout=CLOSING)
        raise


def configuration() -> dict[str, Any]:
    """What differs from Dask's defaults; variables that the user has set win over what stands here."""
    import dask

    environment = "distributed.nanny.pre-spawn-environ"
    return {
        "distributed.worker.profile.enabled": False,
        environment: {**dask.config.get(environment), **ALLOCATOR},
    }
