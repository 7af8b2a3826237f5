"""Who works on something: a file beside it that is renewed while the work goes on.

Two runs on one store must not clear what the other is writing, nor wait for one that died. A lease that nobody has
renewed for ``EXPIRY`` seconds, by the watch of the one who waits, is nobody's: clocks of machines differ, and a file
system's times are those of another machine. On the same machine a process that is gone is seen at once. Creating,
renewing and taking over are single steps of the storage, each of which fails where another was faster.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath
from typing import Any

import psutil

from zsmoseg.stores import files
from zsmoseg.stores.files import Stat
from zsmoseg.stores.records import read_json

BEAT = 5.0
"""Seconds from one renewal to the next."""
EXPIRY = 30.0
"""Seconds without one after which a lease is nobody's: a machine that is busy may miss some beats."""
OLD = 600.0
"""Seconds since the last renewal, by the file system, after which there is no need to watch: clocks differ by less."""
PAUSE, FAR_PAUSE = 0.2, 2.0
"""Seconds between two looks; where each is a request that somebody pays for."""


@contextmanager
def lease(
    path: PurePath, done: Callable[[], bool] = lambda: False, wait: bool = True, steal: bool = False
) -> Iterator[bool]:
    """Hold the lease ``path`` for the time of the block; wait for others that hold it.

    Parameters
    ----------
    done
        Whether there is nothing to do any more.
    wait
        Whether to wait for a holder that may be alive.
    steal
        Whether one that nobody has touched for ``EXPIRY`` seconds, by the file system, is nobody's without watching.

    Yields
    ------
    Whether it is held: not where ``done`` says so while waiting, or where somebody has it and ``wait`` is false.
    """
    with files.no_look():
        held = _wait(path, done, wait, steal)
        if held is None:
            yield False
            return
        _heart.add(held)
        try:
            yield True
        finally:
            _heart.discard(held)
            held.give_up()


def sweep(folder: PurePath) -> None:
    """Take away what killed runs left below a folder."""
    for name in [name for name in files.listing(folder) if files.is_ours(name, leases=True)]:
        path = folder / name
        seen = files.signature(path)
        if seen is not None and _dead(path, seen):
            held = _Held(path, _myself())
            if held.take(seen):
                held.give_up()


@dataclass(eq=False)
class _Held:
    """A lease of ours: what stands in it, and the file as we wrote it last."""

    path: PurePath
    holder: dict[str, Any]
    file: Stat | None = None
    beats: int = 0

    def _content(self) -> bytes:
        return json.dumps({**self.holder, "beats": self.beats}).encode()

    def create(self) -> bool:
        """Whether it was nobody's, and is ours now."""
        self.file = files.create(self.path, self._content())
        return self.file is not None

    def take(self, seen: Stat) -> bool:
        """Whether it was as ``seen`` until now, and is ours now."""
        self.file = files.take(self.path, self._content(), seen)
        return self.file is not None

    def beat(self) -> None:
        """Say that it is still ours, if it is."""
        if self.file is not None:
            self.beats += 1
            # a disk or a network that is away for a moment comes back, or the lease expires
            with suppress(OSError):
                self.file = files.renew(self.path, self._content(), self.file)

    def give_up(self) -> None:
        """Take it away, unless it is another's by now."""
        if self.file is not None and _read(self.path).get("id") == self.holder["id"]:
            files.unlink(self.path)


class _Heart:
    """Beats for all leases of this process, in one thread: a thread a lease takes longer than what a short video does."""

    def __init__(self) -> None:
        self._held: set[_Held] = set()
        self._beating = threading.Lock()
        self._process = 0

    def add(self, held: _Held) -> None:
        """From now on."""
        with self._beating:
            self._held.add(held)
        if self._process != os.getpid():  # the first, or the first after a fork
            self._process = os.getpid()
            threading.Thread(target=self._beat, daemon=True).start()

    def discard(self, held: _Held) -> None:
        """No more; a beat that is under way ends first, so that none comes after."""
        with self._beating:
            self._held.discard(held)

    def _beat(self) -> None:
        while True:
            time.sleep(BEAT)
            with self._beating:
                held = list(self._held)
            for each in held:
                with self._beating:
                    if each in self._held:
                        each.beat()


_heart = _Heart()


def _wait(path: PurePath, done: Callable[[], bool], wait: bool, steal: bool) -> _Held | None:
    """Our lease, once we hold it; None where ``done`` came first, or at once without ``wait``."""
    mine = _Held(path, _myself())
    last: tuple[Stat | None, float] = (None, 0.0)
    while not mine.create():
        if done():
            return None
        seen, now = files.signature(path), time.monotonic()
        if seen != last[0]:
            last = seen, now
        if seen is None:
            continue
        if now - last[1] > EXPIRY or _dead(path, seen, steal):
            if mine.take(seen):
                return mine
        elif not wait:
            return None
        else:
            time.sleep(FAR_PAUSE if files.is_remote(path) else PAUSE)
    return mine


def _myself() -> dict[str, Any]:
    return {**_process(os.getpid()), "id": uuid.uuid4().hex}


@lru_cache(maxsize=1)
def _process(pid: int) -> dict[str, Any]:
    """What says that it is this process; ``pid`` is another after a fork."""
    return {"host": socket.gethostname(), "pid": pid, "started": psutil.Process(pid).create_time()}


def _read(path: PurePath) -> dict[str, Any]:
    """What stands in a lease; nothing where it is gone, or half written by a machine without hard links."""
    return read_json(path) or {}


def _dead(path: PurePath, seen: Stat, steal: bool = False) -> bool:
    """Whether the holder is a process of this machine that is gone, or nobody has renewed it for very long."""
    idle = (_now(path) if steal else time.time()) - seen.modified / 1e9
    if idle > (EXPIRY if steal else OLD):
        return True
    held = _read(path)
    if held.get("host") != socket.gethostname():
        return False
    try:
        return bool(psutil.Process(held["pid"]).create_time() != held["started"])
    except psutil.NoSuchProcess:
        return True
    except (psutil.Error, KeyError, TypeError, ValueError):
        return False


def _now(path: PurePath) -> float:
    """The time of the storage on which a lease lies: its clock may be another than ours."""
    probe = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    files.write(probe, b"")
    seen = files.signature(probe)
    files.unlink(probe)
    return seen.modified / 1e9 if seen else 0.0
