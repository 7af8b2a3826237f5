"""One part of one stage, as it runs on a worker: small arguments in, arrays through the store, a small record out."""

from __future__ import annotations

import resource
import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.errors import StoreError, ZsmosegError, in_words, stops_all

if TYPE_CHECKING:
    from zsmoseg.stores.artifact import Artifact
    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.stage import Stage


@dataclass(frozen=True)
class Job:
    """One part of one stage of one video; small, and can be pickled.

    ``frames`` is the key that holds the probe, ``networks`` where networks run, ``network`` whether one may;
    ``promise`` is what its key says of files that it may read (``trust.py``); ``steal``: see ``Request``.
    """

    store: str
    video: str
    stage: str
    key: str
    part: int
    start: int
    stop: int
    frames: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, str]
    out: str = ""
    graph: str = "embedded-flow"
    networks: Mapping[str, Any] = field(default_factory=dict)
    network: bool = False
    promise: Mapping[str, str] = field(default_factory=dict)
    steal: bool = False

    @property
    def name(self) -> str:
        """Readable and unique within a run."""
        return f"{self.stage}-{self.video}-{self.key[:10]}-{self.part:04d}"


@dataclass(frozen=True)
class Outcome:
    """What became of a job: done, failed (why) or skipped because something before it failed.

    ``stops``: no other job would fare better.
    """

    state: str
    seconds: float = 0.0
    memory_mb: float = 0.0
    facts: Mapping[str, Any] | None = None
    error: str = ""
    trace: str = ""
    stops: bool = False


def run_job(job: Job, *before: Outcome) -> Outcome:
    """Run one part unless its record says that it is done; never raises on what a task can do wrong."""
    if any(outcome.state != "done" for outcome in before):
        return Outcome("skipped")
    try:
        with one_thread():
            return _run(job)
    except ZsmosegError as error:
        return Outcome("failed", error=str(error), stops=stops_all(error))
    except MemoryError:
        return Outcome(
            "failed", error="out of memory; use fewer workers (--workers) or a smaller chunk.length"
        )
    except Exception as error:
        words = in_words(error)
        if words is not None:
            return Outcome("failed", error=words, stops=stops_all(error))
        what = f"unexpected {type(error).__name__}: {error}"
        return Outcome("failed", error=what, trace=traceback.format_exc())


def _run(job: Job) -> Outcome:
    from zsmoseg.settings import Networks, Settings
    from zsmoseg.stores.checks import part_problem
    from zsmoseg.stores.files import full_disk_in_words
    from zsmoseg.stores.leases import lease
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.writer import PartWriter
    from zsmoseg.video.probe import Probe
    from zsmoseg.workflows.running.trust import refuse_changed
    from zsmoseg.workflows.stage import Part
    from zsmoseg.workflows.stages.graph import GRAPHS

    clock = time.process_time()
    stage, store = GRAPHS[job.graph][job.stage], Store.open(job.store, create=False)
    described = _described(store.artifact(job.video, "frames", job.frames))
    part = Part(
        Probe.from_json(described["probe"]),
        job.start,
        job.stop,
        Path(job.out),
        networks=Networks.model_validate(dict(job.networks)),
    )
    artifact = store.artifact(job.video, job.stage, job.key)
    if not stage.output:
        _described(artifact)
    if not stage.output and not part_problem(artifact, job.part):
        return Outcome("done", time.process_time() - clock, peak_memory_mb())
    sections = stage.chosen(Settings.model_validate(dict(job.settings)))
    left = stage.task(part, _inputs(job, stage, store), sections)
    if stage.output:
        with full_disk_in_words(Path(job.out)):
            list(left)
        refuse_changed(job.promise, job.stage, part, sections, store)
        return Outcome("done", time.process_time() - clock, peak_memory_mb(), part.facts)
    path = artifact.lease_path(job.part)
    with lease(path, lambda: not part_problem(artifact, job.part), steal=job.steal) as ours:
        # somebody else may have finished it while this run waited, or just before: what is finished stays
        if not ours or not part_problem(artifact, job.part):
            return Outcome("done", time.process_time() - clock, peak_memory_mb())
        with PartWriter(artifact, job.part) as writer:
            for block in left:
                writer.put(block)
            refuse_changed(job.promise, job.stage, part, sections, store)
            seconds = time.process_time() - clock - part.warm_up
            warm_up = {"warm_up": round(part.warm_up, 4)} if part.opened else {}
            writer.facts = {**part.facts, **warm_up, "seconds": round(seconds, 4)}
    return Outcome("done", seconds, peak_memory_mb())


def _described(artifact: Artifact) -> dict[str, Any]:
    """What was laid out before the first job."""
    found = artifact.description
    if found is None:
        raise StoreError(f"{artifact.path}: is gone or damaged; run the same command again")
    return found


def _inputs(job: Job, stage: Stage[Any, Any], store: Store) -> Any:
    """What the task may read: the frames of its part and as many beyond them as it declared; read when used."""
    from zsmoseg.workflows.stage import ALL

    found = {}
    for name, kind in stage.reads.items():
        artifact, reach = store.artifact(job.video, name, job.inputs[name]), stage.reaches[name]
        found[name] = (
            kind.read(artifact) if reach == ALL else kind.read(artifact, job.start, job.stop + reach)
        )
    return stage.inputs(**found)


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV and BLAS in one thread: more would crowd the cores, and sums must not depend on their number."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _thread_pools().limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


@cache
def _thread_pools() -> Any:
    """The pools of this process; the modules of all stages, and with them their libraries, are loaded first."""
    from threadpoolctl import ThreadpoolController

    import_module("zsmoseg.workflows.stages.graph")
    return ThreadpoolController()


def peak_memory_mb() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if sys.platform == "darwin" else 2**10), 1)
