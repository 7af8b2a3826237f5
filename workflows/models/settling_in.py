"""Models get their place in one step: put together beside it, moved there when whole."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from zsmoseg.errors import ModelError, SpaceError
from zsmoseg.networks.contract import NAME
from zsmoseg.workflows.models.place import staging

LOCK = ".lock"
"""Beside the folder: on Windows what lies in a folder and is open keeps it where it is."""


@contextmanager
def put_together(target: Path, keep: bool = False) -> Iterator[Path]:
    """The folder in which a model is put together, by one process at a time.

    Parameters
    ----------
    target
        Where the model is going to be.
    keep
        Whether files stay for the next attempt when this one fails (downloads).

    Raises
    ------
    ModelError
        Another process is at it, or a file cannot be read or written.
    SpaceError
        The disk is full.
    """
    work = staging(target)
    try:
        work.mkdir(parents=True, exist_ok=True)
        lock = work.with_name(work.name + LOCK)
        with FileLock(lock, timeout=0):
            try:
                yield work
            finally:
                if work.is_dir() and not (keep and any(work.iterdir())):
                    shutil.rmtree(work)
                with suppress(OSError):  # Windows takes it away when it is let go
                    lock.unlink()
    except Timeout as error:
        raise ModelError(f"{target}: another zsmoseg models is putting it together; wait for it") from error
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            left = "; what was fetched is kept" if keep else ""
            raise SpaceError(
                f"{target.parent}: the disk is full{left}; make room and repeat, or set ZSMOSEG_MODELS to "
                "another disk"
            ) from error
        raise ModelError(
            f"{error.filename or work}: {error.strerror or error}; the models folder must be writable, "
            "ZSMOSEG_MODELS sets another"
        ) from error


def settle(work: Path, target: Path, files: Collection[str]) -> None:
    """Move a model that is whole to its place, instead of what is there; files it does not name go."""
    for path in work.iterdir():
        if path.name not in files and path.name != NAME:
            path.unlink()
    old = target.with_name(f".{target.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        os.replace(target, old)
    os.replace(work, target)
    shutil.rmtree(old, ignore_errors=True)
