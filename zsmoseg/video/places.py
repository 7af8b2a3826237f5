"""Where sources lie: on this machine or behind a URL. Names are text, as users give them and as probes keep them."""

from __future__ import annotations

import glob
import os
import re
import stat
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from zsmoseg.errors import VideoError
from zsmoseg.remote import bucket
from zsmoseg.remote.copies import local_copy
from zsmoseg.remote.looks import Stat
from zsmoseg.remote.url import READABLE, URL, WRITABLE, is_url, place

TOOLS = {"__MACOSX", "@eaDir", "#recycle", "$RECYCLE.BIN", "System Volume Information", "lost+found"}
"""Folders that systems leave among those of users; others begin with a dot."""
SPECIAL = {
    stat.S_ISFIFO: "is a pipe, which can be read only once",
    stat.S_ISSOCK: "is a socket",
    stat.S_ISCHR: "is a device",
    stat.S_ISBLK: "is a device",
}


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
    if is_url(argument):
        return str(found)
    return _literal(argument) if is_pattern(argument) else argument


def is_pattern(name: str) -> bool:
    """Whether a name means others: it has characters of patterns, and nothing is called just so."""
    return glob.has_magic(name) and not is_file(name) and not is_folder(name)


def _literal(pattern: str) -> str:
    """The pattern in which folders at the front that are called just so are meant as they stand."""
    fixed, parts = Path(), Path(pattern).parts
    for n, part in enumerate(parts):
        if not os.path.lexists(fixed / part):
            return str(Path(glob.escape(str(fixed)), *parts[n:]))
        fixed /= part
    return pattern


def within(folder: str, name: str) -> str:
    """The pattern of what is called like ``name`` in a folder."""
    return f"{glob.escape(folder)}/{name}"


def unescaped(pattern: str) -> str:
    """The name that a pattern without wild cards means."""
    return re.sub(r"\[([*?[])\]", r"\1", pattern)


def special(name: str) -> str:
    """What there is that is neither file nor folder, in words; nothing where there is none."""
    try:
        mode = 0 if url(name) is not None else os.stat(name).st_mode
    except (OSError, ValueError):
        return ""
    return next((words for is_one, words in SPECIAL.items() if is_one(mode)), "")


def nothing_there(name: str) -> VideoError:
    """The error for a name of neither a file nor a folder."""
    found = "is standard input, which can be read only once" if name == "-" else special(name)
    return VideoError(
        f"{name}: {found}; give a video file or a folder of images"
        if found
        else f"{name}: no such file or folder"
    )


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
    """What is in a folder; what is hidden, of the system, or neither file nor folder is left out."""
    far = url(name)
    if far is None:
        return [e.path for e in os.scandir(name) if not _passed_over(e.name) and not _is_special(e)]
    names = dict.fromkeys(inner.partition("/")[0] for inner in bucket.listing(far))
    return [f"{far}/{inner}" for inner in names if not _passed_over(inner)]


def _passed_over(name: str) -> bool:
    return name.startswith(".") or name in TOOLS


def _is_special(entry: os.DirEntry[str]) -> bool:
    """A link that leads nowhere is none: it stands for a file that is missed."""
    return not entry.is_file() and not entry.is_dir() and bool(special(entry.path))


def matches(pattern: str) -> list[str]:
    """What has a name like ``pattern`` (``*``, ``?``, ``[a-z]``, and ``**`` for any folders)."""
    far = url(pattern)
    if far is None:
        asked = set(Path(pattern).parts)
        found = glob.glob(pattern, recursive=True)
        return [name for name in found if not special(name) and not TOOLS & {*Path(name).parts} - asked]
    fixed = next(n for n, part in enumerate(far.parts) if glob.has_magic(part))
    root, wanted = URL(*far.parts[:fixed]), far.parts[fixed:]
    names = {tuple(name.split("/")) for name in bucket.listing(root)}
    names |= {name[:length] for name in names for length in range(1, len(name))}
    return [f"{root}/{'/'.join(name)}" for name in names if _fits(name, wanted)]


def _fits(name: tuple[str, ...], pattern: tuple[str, ...]) -> bool:
    """Whether the parts of a path fit those of a pattern; what is hidden has to be asked for."""
    if not pattern or not name:
        return not name and set(pattern) <= {"**"}
    visible = not _passed_over(name[0])
    if pattern[0] == "**":
        return _fits(name, pattern[1:]) or (visible and _fits(name[1:], pattern))
    shown = visible or pattern[0].startswith(".") or pattern[0] == name[0]
    return shown and fnmatchcase(name[0], pattern[0]) and _fits(name[1:], pattern[1:])


def absolute(name: str) -> str:
    """The name wherever who reads it stands: workers may stand in another folder."""
    if url(name) is not None:
        return name
    if is_pattern(name) and not os.path.isabs(name):
        return os.path.normpath(os.path.join(glob.escape(os.getcwd()), name))
    return os.path.abspath(name)


def identities(names: Sequence[str]) -> tuple[str, ...]:
    """Of each what is the same for two names of one file; what their folders are is looked up once for all."""
    here = {os.path.dirname(name) for name in names if url(name) is None}
    real = {folder: os.path.realpath(folder) for folder in here}

    def identity(name: str) -> str:
        if (folder := real.get(os.path.dirname(name))) is None:
            return name
        return (
            os.path.realpath(name) if os.path.islink(name) else os.path.join(folder, os.path.basename(name))
        )

    return tuple(map(identity, names))


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
