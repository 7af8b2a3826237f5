"""One part of one stage, as it runs on a worker: small arguments in, arrays through the store, a small record out."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.errors import StoreError, ZsmosegError, in_words, stops_all

if TYPE_CHECKING:
    from zsmoseg.stores.arrays import Arrays
    from zsmoseg.stores.artifact import Artifact
    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.running.warming import Clock
    from zsmoseg.workflows.stage import Part, Stage

AGAIN = "run the same command again"


@dataclass(frozen=True)
class Job:
    """One part of one stage of one video; small, and can be pickled.

    ``frames`` is the key that holds the probe, ``networks`` where networks run, ``network`` whether one may;
    ``promise`` is what its key says of files that it may read (``trust.py``); ``packed``: it leaves one file; ``steal``: see
    ``Request``; ``deadline``: the seconds that it has (``deadlines.py``).
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
    packed: bool = False
    steal: bool = False
    deadline: float = inf

    @property
    def name(self) -> str:
        """Readable and unique within a run."""
        return f"{self.stage}-{self.video}-{self.key[:10]}-{self.part:04d}"


@dataclass(frozen=True)
class Outcome:
    """What became of a job: done, failed (why) or skipped because something before it failed.

    ``seconds`` of the processor and ``wall`` of the clock, without ``warm_up``: networks opened, functions compiled;
    ``found``: another run had done it; ``stops``: no other job would fare better.
    """

    state: str
    seconds: float = 0.0
    wall: float = 0.0
    warm_up: float = 0.0
    found: bool = False
    memory_mb: float = 0.0
    facts: Mapping[str, Any] | None = None
    error: str = ""
    trace: str = ""
    stops: bool = False


def run_job(job: Job, *before: Outcome) -> Outcome:
    """Run one part unless its record says that it is done; never raises on what a task can do wrong."""
    if any(outcome.state != "done" for outcome in before):
        return Outcome("skipped")
    from zsmoseg.stores.files import folder, glancing_at
    from zsmoseg.stores.location import Store

    try:
        with one_thread(), glancing_at(Store(folder(job.store)).video(job.video).path):
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
    from zsmoseg.stores.files import errors_in_words, folder
    from zsmoseg.stores.location import Store
    from zsmoseg.video.probe import Probe
    from zsmoseg.workflows.running.trust import refuse_changed
    from zsmoseg.workflows.running.warming import Clock
    from zsmoseg.workflows.stage import Part
    from zsmoseg.workflows.stages.graph import GRAPHS

    clock = Clock()
    stage, store = GRAPHS[job.graph][job.stage], Store.open(job.store, create=False)
    looked = store.video(job.video).probe(job.frames)
    if looked is None:
        raise StoreError(f"{store.path}: the probe of {job.video} is gone or damaged; {AGAIN}")
    part = Part(
        Probe.from_json(looked),
        job.start,
        job.stop,
        folder(job.out) if stage.output else Path(),
        networks=Networks.model_validate(dict(job.networks)),
        before=_before(job, stage, store),
    )
    artifact = store.artifact(job.video, job.stage, job.key)
    if not stage.output and not part_problem(artifact, job.part):
        return _done(clock, part, found=True)
    sections = stage.chosen(Settings.model_validate(dict(job.settings)))
    left = stage.task(part, _inputs(job, stage, store), sections)
    if stage.output:
        with errors_in_words(part.out):
            list(left)
        refuse_changed(job.promise, job.stage, part, sections, store)
        return _done(clock, part, facts=part.facts)

    def facts() -> dict[str, Any]:
        refuse_changed(job.promise, job.stage, part, sections, store)
        seconds, _, warm_up = clock.taken(part.warm_up)
        told = {"warm_up": round(warm_up, 4)} if part.opened or warm_up else {}
        return {**part.facts, **told, "seconds": round(seconds, 4)}

    _keep(job, artifact, stage, part, left, facts)
    return _done(clock, part)


def _done(clock: Clock, part: Part, **more: Any) -> Outcome:
    seconds, wall, warm_up = clock.taken(part.warm_up)
    return Outcome("done", seconds, wall, warm_up, memory_mb=peak_memory_mb(), **more)


def _keep(
    job: Job,
    artifact: Artifact,
    stage: Stage[Any, Any],
    part: Part,
    left: Iterable[Arrays],
    facts: Callable[[], dict[str, Any]],
) -> None:
    """Write what a task leaves, unless somebody else finished it while this run waited, or just before."""
    from zsmoseg.stores.artifact import part_name
    from zsmoseg.stores.checks import part_problem
    from zsmoseg.stores.files import glancing_at, no_look
    from zsmoseg.stores.leases import lease
    from zsmoseg.stores.sealing import seal_once
    from zsmoseg.stores.writer import PartWriter, write_archive
    from zsmoseg.workflows.stage import description, first_record

    path = artifact.lease_path(part_name(job.part))
    taken = lease(path, lambda: not part_problem(artifact, job.part), steal=job.steal)
    # the second look: what others have done until the lease was ours
    with taken as ours, glancing_at(artifact.path.parent.parent):
        if not ours or not part_problem(artifact, job.part):
            return
        if job.packed:
            about = description(stage, job.key, job.settings, job.inputs)
            whole = [(0, part.frames)]
            laid_out = first_record(stage, about, job.promise["source"], part.probe, whole)
            times, names = part.probe.times, part.probe.names
            write_archive(artifact, laid_out, left, stage.leaves, times, names, facts)
            return
        with PartWriter(artifact, job.part) as writer:
            for block in left:
                writer.put(block)
            writer.facts = facts()
    # here and not in the client alone: on many workers that would be the one that all wait for
    with no_look(), glancing_at(artifact.path.parent):
        parts = range(len(artifact.parts))
        if artifact.written == len(parts) and not any(part_problem(artifact, i) for i in parts):
            assert stage.leaves is not None
            seal_once(artifact, stage.leaves, part.probe.times, part.probe.names)


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


def _before(job: Job, stage: Stage[Any, Any], store: Store) -> Any:
    """What the part before this one left, of a stage that goes on from it."""
    if not stage.follows or not job.part or stage.leaves is None:
        return None
    artifact = store.artifact(job.video, job.stage, job.key)
    return stage.leaves.read(artifact, *artifact.parts[job.part - 1])


class _OneThread:
    """What ``one_thread`` found: the first task of a process that enters limits it, the last one that leaves puts it back."""

    def __init__(self) -> None:
        self._lock, self._inside, self._limits = threading.Lock(), 0, ExitStack()

    def enter(self) -> None:
        import cv2

        with self._lock:
            if not self._inside:
                self._limits.callback(cv2.setNumThreads, cv2.getNumThreads())
                cv2.setNumThreads(1)
                self._limits.enter_context(_thread_pools().limit(limits=1))
            self._inside += 1

    def leave(self) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._limits.close()


_ONE_THREAD = _OneThread()


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV and BLAS in one thread: more would crowd the cores, and sums must not depend on their number."""
    _ONE_THREAD.enter()
    try:
        yield
    finally:
        _ONE_THREAD.leave()


@cache
def _thread_pools() -> Any:
    """The pools of this process; the modules of all stages, and with them their libraries, are loaded first."""
    from threadpoolctl import ThreadpoolController

    import_module("zsmoseg.workflows.stages.graph")
    return ThreadpoolController()


def peak_memory_mb() -> float:
    """Largest resident size of this process so far."""
    try:
        from resource import RUSAGE_SELF, getrusage
    except ImportError:  # Windows
        import psutil

        told = psutil.Process().memory_info()
        return round(float(getattr(told, "peak_wset", told.rss)) / 2**20, 1)
    return round(getrusage(RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10), 1)
