"""What the workers of somebody's Dask cluster must be able to do, found before work starts and named; waiting for them."""

from __future__ import annotations

import hashlib
import os
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePath
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, TypeVar

import zsmoseg.stores
import zsmoseg.workflows
from zsmoseg import __version__
from zsmoseg.errors import ClusterError, in_words
from zsmoseg.remote.url import is_url
from zsmoseg.stores import files
from zsmoseg.video import places
from zsmoseg.video.sources import image_files

T = TypeVar("T")
SHOWN = 4
"""Workers that a message names."""
SOURCES = 32
"""Sources that every worker looks for: more would be too many questions to a disk that a thousand workers share."""
ANSWER = 60.0
"""Seconds within which workers and scheduler must answer a question: a busy one takes seconds."""
LATE = 3
"""Seconds that a file may take to be seen on another machine (the caches of NFS)."""

INSTALLED = (
    "[getattr(__import__('zsmoseg'), '__version__', '?') if __import__('importlib.util').util.find_spec('zsmoseg')"
    " else None, __import__('platform').python_version()]"
)
"""Asked of workers in plain Python: those that lack the package understand it too."""


@cache
def code() -> str:
    """Digest of the package's own modules: a version stays the same while somebody changes the code."""
    roots = {"": zsmoseg, "stores": zsmoseg.stores, "workflows": zsmoseg.workflows}
    found = {
        os.path.join(front, os.path.relpath(folder, root), name): os.path.join(folder, name)
        for front, package in roots.items()
        for root in package.__path__[:1]
        for folder, _, names in os.walk(root)
        for name in names
        if name.endswith(".py")
    }
    named, whole = {os.path.normpath(name): path for name, path in found.items()}, hashlib.sha256()
    for name, path in sorted(named.items()):
        with open(path, "rb") as file:
            whole.update(f"{name} ".encode() + hashlib.sha256(file.read()).digest())
    return whole.hexdigest()


@dataclass(frozen=True)
class Needs:
    """What a run needs from workers of others: to see these, to run the same ``code``; ``out``: folders to write in."""

    store: str
    record: str
    sources: Sequence[str]
    out: Sequence[str]
    code: str = field(default_factory=code)

    @classmethod
    def of(cls, store: str, record: str, sources: Sequence[str], out: Sequence[str]) -> Needs:
        """Of all sources a sample."""
        step = max(1, len(sources) // SOURCES)
        return cls(store, record, tuple(sources[::step]), tuple(out[:1]))


def look(needs: Needs) -> str | None:
    """On a worker: what is wrong, None if nothing is."""
    try:
        return _look(needs)
    except OSError as error:
        return f"cannot get at the store {needs.store} ({in_words(error)})"


def _look(needs: Needs) -> str | None:
    """The record of the run must be there: a folder of the same name on another disk is no store."""
    if code() != needs.code:
        return f"has other code than this machine under the same version {__version__}"
    for _ in range(LATE):
        if files.exists(files.folder(needs.record)):
            break
        time.sleep(1)
    else:
        return f"does not see the store {needs.store} (no {needs.record} there)"
    for source in needs.sources:
        if not _readable(source):
            return f"cannot read the source {source}"
    for folder in (needs.store, *needs.out):
        problem = _write_problem(files.folder(folder))
        if problem:
            return f"cannot write in {folder} ({problem})"
    return None


def _readable(source: str) -> bool:
    """Whether a file can be opened, a folder listed; of a glob the folder counts."""
    try:
        if is_url(source):
            return places.is_file(source) or bool(image_files(source))
        if os.path.isfile(source):
            with open(source, "rb") as file:
                file.read(1)
        else:
            os.listdir(source if os.path.isdir(source) else _folder_of_glob(source))
    except OSError:
        return False
    return True


def _folder_of_glob(pattern: str) -> str:
    import glob

    while glob.has_magic(pattern):
        pattern = os.path.dirname(pattern)
    return pattern


def _write_problem(folder: PurePath) -> str | None:
    probe = folder / f".look.{uuid.uuid4().hex}.tmp"
    if not files.is_folder(folder):
        return f"{folder}: no such folder"
    try:
        files.write(probe, b"")
        files.remove(probe)
    except OSError as error:
        return in_words(error)
    return None


def within(seconds: float, ask: Callable[[], T]) -> T:
    """What ``ask`` gives; calls into Dask know no deadline of their own.

    Raises
    ------
    ClusterError
        If nothing comes within ``seconds``.
    """
    answers: SimpleQueue[tuple[bool, Any]] = SimpleQueue()

    def work() -> None:
        try:
            answers.put((True, ask()))
        except BaseException as error:
            answers.put((False, error))

    Thread(target=work, daemon=True).start()
    try:
        good, answer = answers.get(timeout=seconds)
    except Empty as error:
        raise ClusterError(f"no answer within {seconds:.0f} s") from error
    if not good:
        raise answer
    return answer  # type: ignore[no-any-return]


def problems(client: Any, workers: Sequence[str], needs: Needs) -> dict[str, str]:
    """What is wrong with each of ``workers`` with whom something is; those that went meanwhile are no problem."""
    found: dict[str, str] = {}
    installed = _ask(client, workers, eval, INSTALLED)
    for worker, answer in installed.items():
        if isinstance(answer, Exception):
            if not isinstance(answer, OSError):  # it is gone
                found[worker] = f"cannot load zsmoseg ({type(answer).__name__}: {answer})"
        elif answer[0] is None:
            found[worker] = f"has no zsmoseg installed (its Python is {answer[1]})"
        elif answer[0] != __version__:
            found[worker] = f"has zsmoseg {answer[0]}, this is {__version__}"
    good = [w for w, a in installed.items() if w not in found and not isinstance(a, Exception)]
    for worker, answer in _ask(client, good, look, needs).items():
        if isinstance(answer, Exception) and not isinstance(answer, OSError):
            found[worker] = f"has another zsmoseg ({type(answer).__name__}: {answer})"
        elif isinstance(answer, str):
            found[worker] = answer
    return found


def _ask(client: Any, workers: Sequence[str], *question: Any) -> Mapping[str, Any]:
    """The answers, or exceptions, by worker; no worker, no question."""
    if not workers:
        return {}
    answers: Mapping[str, Any] = within(
        ANSWER, lambda: client.run(*question, workers=list(workers), on_error="return")
    )
    return answers


def refuse(found: Mapping[str, str], present: Mapping[str, Any]) -> None:
    """Raise ``ClusterError`` with the names of the workers that cannot do the work; ``present``: all, by address."""
    if not found:
        return
    by_problem: dict[str, list[str]] = {}
    for worker, problem in found.items():
        name = str(present[worker].get("name", worker))
        by_problem.setdefault(problem, []).append(worker if name == worker else f"{name} ({worker})")
    words = []
    for problem, names in by_problem.items():
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        words.append(f"{', '.join(names[:SHOWN])}{more}: {problem}")
    raise ClusterError(
        f"{len(found)} of {len(present)} workers cannot do this work: {'; '.join(words)}; start all workers in the same "
        "environment, on machines that see store, sources and output under the same paths"
    )
