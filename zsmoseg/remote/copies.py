"""Files behind URLs as files of this machine: a copy each, in a folder of bounded size, as fresh as the last question."""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
import uuid
from contextlib import suppress
from pathlib import Path

from zsmoseg.errors import AccessError
from zsmoseg.remote import bucket
from zsmoseg.remote.url import URL

BOUND = 8 << 30
"""Bytes of all copies; one file that is larger is kept alone."""
RECENT = 60.0
"""Seconds for which a copy is not taken away: somebody may be about to open it."""


def folder() -> Path:
    """Where copies are, of this user alone: below ``TMPDIR``, which batch systems set to a disk of the node.

    Raises
    ------
    AccessError
        If somebody else made that folder.
    """
    shared = hasattr(os, "getuid")  # on Windows every user has a TEMP
    path = Path(tempfile.gettempdir()) / (f"zsmoseg-{os.getuid()}" if shared else "zsmoseg")
    path.mkdir(mode=0o700, exist_ok=True)
    found = path.lstat()
    if shared and (path.is_symlink() or found.st_uid != os.getuid() or found.st_mode & 0o022):
        raise AccessError(f"{path}: others may write there; remove it, or set TMPDIR to a folder of your own")
    return path


def local_copy(url: URL) -> Path:
    """A file with the content that ``url`` has now; one request, which reads nothing where a copy is fresh.

    Raises
    ------
    OSError
        If there is none, or it cannot be read.
    """
    place, name = folder(), hashlib.sha256(str(url).encode()).hexdigest()[:32]
    known = {_stamp(copy): copy for copy in place.glob(f"{name}.*")}
    partial = place / f".{uuid.uuid4().hex}.tmp"
    try:
        stamp = bucket.fetch(url, partial, next(iter(known), None))
        if stamp in known:
            os.utime(known[stamp])
            return known[stamp]
        copy = place / f"{name}.{stamp.encode().hex()}{url.suffix}"
        partial.replace(copy)
    finally:
        partial.unlink(missing_ok=True)
    _keep_bound(place, set(known.values()), copy)
    return copy


def _stamp(copy: Path) -> str:
    """The name says what a copy is one of: nobody sees one with the stamp of another."""
    return bytes.fromhex(copy.name.split(".")[1]).decode()


def _keep_bound(place: Path, replaced: set[Path], new: Path) -> None:
    """Take away what was replaced, then what was not used for longest."""
    found = []
    for path in place.iterdir():
        with suppress(FileNotFoundError):
            found.append((path, path.stat()))
    free = BOUND - sum(stat.st_size for _, stat in found)
    for path, stat in sorted(found, key=lambda one: (one[0] not in replaced, one[1].st_mtime)):
        used = time.time() - stat.st_mtime < RECENT
        if path != new and not used and (free < 0 or path in replaced):
            path.unlink(missing_ok=True)
            free += stat.st_size
