"""Who works on something: a file beside it that is touched while the work goes on.

Two runs on one store must not clear what the other is writing, nor wait for one that died. A lease that nobody has
touched for ``EXPIRY`` seconds, by the watch of the one who waits, is nobody's: clocks of machines differ, and a file
system's times are those of another machine. On the same machine a process that is gone is seen at once.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

from zsmoseg.stores import files

BEAT = 5.0
"""Seconds from one touch to the next."""
EXPIRY = 30.0
"""Seconds without a touch after which a lease is nobody's: a machine that is busy may miss some beats."""
OLD = 600.0
"""Seconds since the last touch, by the file system, after which there is no need to watch: clocks differ by less."""
PAUSE = 0.2
"""Seconds between two looks."""


@contextmanager
def lease(
    path: Path, done: Callable[[], bool] = lambda: False, wait: bool = True, steal: bool = False
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
    mine = _wait(path, done, wait, steal)
    if mine is None:
        yield False
        return
    stop = threading.Event()
    beat = threading.Thread(target=_beat, args=(path, stop), daemon=True)
    beat.start()
    try:
        yield True
    finally:
        stop.set()
        beat.join()
        if files.read(path) == mine:
            files.remove(path)


def sweep(folder: Path) -> None:
    """Take away what killed runs left in a folder."""
    for path in files.matching(folder, "*.lease"):
        signature = files.signature(path)
        if signature is not None and _dead(path, signature):
            _clear(path)


def _beat(path: Path, stop: threading.Event) -> None:
    while not stop.wait(BEAT):
        try:
            files.touch(path)
        except OSError:
            return


def _wait(path: Path, done: Callable[[], bool], wait: bool, steal: bool) -> bytes | None:
    """What our lease says, once we hold it; None where ``done`` came first, or at once without ``wait``."""
    mine = json.dumps(_myself()).encode()
    seen: tuple[Any, float] = (None, 0.0)
    while not files.create(path, mine):
        if done():
            return None
        signature, now = files.signature(path), time.monotonic()
        if signature != seen[0]:
            seen = signature, now
        if signature is not None and (now - seen[1] > EXPIRY or _dead(path, signature, steal)):
            _clear(path)
        elif not wait:
            return None
        else:
            time.sleep(PAUSE)
    return mine


def _myself() -> dict[str, Any]:
    process = psutil.Process()
    return {
        "host": socket.gethostname(),
        "pid": process.pid,
        "started": process.create_time(),
        "id": uuid.uuid4().hex,
    }


def _dead(path: Path, signature: tuple[int, ...], steal: bool = False) -> bool:
    """Whether the holder is a process of this machine that is gone, or nobody has touched it for very long."""
    if (_now(path) - signature[0] / 1e9 > EXPIRY) if steal else (time.time() - signature[0] / 1e9 > OLD):
        return True
    try:
        held = json.loads(files.read(path) or b"")
        host, pid, started = held["host"], held["pid"], held["started"]
    except (ValueError, KeyError, TypeError):
        return False
    if host != socket.gethostname():
        return False
    try:
        return bool(psutil.Process(pid).create_time() != started)
    except psutil.NoSuchProcess:
        return True
    except psutil.Error:
        return False


def _now(path: Path) -> float:
    """The time of the file system on which a lease lies: its clock may be another than ours."""
    probe = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    files.write(probe, b"")
    seen = files.signature(probe)
    files.remove(probe)
    return seen[0] / 1e9 if seen else 0.0


def _clear(path: Path) -> None:
    """Take a lease away that is nobody's: whoever renames it first does, and looks at what was taken."""
    before = files.read(path)
    taken = path.with_name(f".{path.name}.{os.getpid()}.{uuid.uuid4().hex}.tmp")
    if files.move(path, taken):
        if files.read(taken) != before:
            files.create(path, files.read(taken) or b"")
        files.remove(taken)
