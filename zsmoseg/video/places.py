"""Where sources lie: on this machine or behind a URL. Names are text, as users give them and as probes keep them."""

from __future__ import annotations

import glob
import os
from fnmatch import fnmatchcase
from pathlib import Path

from zsmoseg.errors import VideoError
from zsmoseg.remote import bucket
from zsmoseg.remote.copies import local_copy
from zsmoseg.remote.looks import Stat
from zsmoseg.remote.url import READABLE, URL, WRITABLE, is_url, place


def url(name: str) -> URL | None:
    """The URL that a name is, as ``settled`` left it; None where it is a path."""
    scheme, sign, rest = name.partition("://")
    return URL(f"{scheme}:/{rest}") if sign and scheme in WRITABLE + READABLE else None


def settled(argument: str) -> str:
    """What a user wrote, as the other functions take it.

    Raises
    ------
    VideoError
        A URL that is not known, or holds a secret.
    """
    found = place(argument, VideoError)
    return str(found) if is_url(argument) else argument


def here(name: str) -> str:
    """A file of this machine with the same content."""
    far = url(name)
    return name if far is None else str(local_copy(far))


def is_folder(name: str) -> bool:
    """Whether there is a folder."""
    far = url(name)
    return os.path.isdir(name) if far is None else bool(bucket.listing(far))


def is_file(name: str) -> bool:
    """Whether there is a file."""
    far = url(name)
    return os.path.isfile(name) if far is None else bucket.stat(far) is not None


def children(name: str) -> list[str]:
    """What is in a folder; hidden ones are left out."""
    far = url(name)
    if far is None:
        return [entry.path for entry in os.scandir(name) if not entry.name.startswith(".")]
    names = dict.fromkeys(inner.partition("/")[0] for inner in bucket.listing(far))
    return [f"{far}/{inner}" for inner in names if not inner.startswith(".")]


def matches(pattern: str) -> list[str]:
    """What has a name like ``pattern`` (``*``, ``?``, ``[a-z]``, and ``**`` for any folders)."""
    far = url(pattern)
    if far is None:
        return glob.glob(pattern, recursive=True)
    fixed = next(n for n, part in enumerate(far.parts) if glob.has_magic(part))
    root, wanted = URL(*far.parts[:fixed]), far.parts[fixed:]
    names = {tuple(name.split("/")) for name in bucket.listing(root)}
    names |= {name[:length] for name in names for length in range(1, len(name))}
    return [f"{root}/{'/'.join(name)}" for name in names if _fits(name, wanted)]


def _fits(name: tuple[str, ...], pattern: tuple[str, ...]) -> bool:
    """Whether the parts of a path fit those of a pattern; what is hidden has to be asked for."""
    if not pattern or not name:
        return not name and set(pattern) <= {"**"}
    visible = not name[0].startswith(".")
    if pattern[0] == "**":
        return _fits(name, pattern[1:]) or (visible and _fits(name[1:], pattern))
    shown = visible or pattern[0].startswith(".")
    return shown and fnmatchcase(name[0], pattern[0]) and _fits(name[1:], pattern[1:])


def absolute(name: str) -> str:
    """The name wherever who reads it stands: workers may stand in another folder."""
    return name if url(name) is not None else os.path.abspath(name)


def identity(name: str) -> str:
    """What is the same for two names of one file."""
    return name if url(name) is not None else os.path.realpath(name)


def parts(name: str) -> tuple[str, ...]:
    """The path from its root on, without that."""
    far = url(name)
    return Path(os.path.abspath(name)).parts[1:] if far is None else far.parts[1:]


def signature(name: str) -> str:
    """What tells a file from another, and from itself when it is written again: a cached fingerprint is found by it."""
    far = url(name)
    if far is None:
        s = os.stat(name)
        return f"{os.path.abspath(name)} {s.st_size} {s.st_mtime_ns} {s.st_ctime_ns} {s.st_ino}"
    stat = _stat(far)
    return f"{far} {stat.size} {stat.modified} {stat.stamp}"


def size_and_time(name: str) -> str:
    """Size and time of change, where that is to be enough."""
    far = url(name)
    if far is None:
        s = os.stat(name)
        return f"{s.st_size} {s.st_mtime_ns}"
    stat = _stat(far)
    return f"{stat.size} {stat.modified}"


def _stat(far: URL) -> Stat:
    found = bucket.stat(far)
    if found is None:
        raise FileNotFoundError(2, "no such file or folder", str(far))
    return found
