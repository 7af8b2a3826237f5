"""Names that come from data: which of them may become paths, and what the others are turned into.

Standard library only.
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import PurePosixPath

LONGEST = 255
"""Bytes of a name, as file systems have it."""
KEPT = 120
"""Bytes that are kept of a name that is made here: endings and the names of several folders still fit."""
SIMPLE = re.compile(r"[\w+-][\w.+-]*(/[\w+-][\w.+-]*)*")
"""Names of which nothing more has to be looked at."""


def parts_of(name: object) -> tuple[str, ...]:
    """The parts of a relative path that stays in the folder it is put in.

    Raises
    ------
    ValueError
        Why it is none: the end of a sentence that begins with the name.
    """
    if not isinstance(name, str):
        raise ValueError("is no text")
    if len(name) < LONGEST // 4 and SIMPLE.fullmatch(name):
        return tuple(name.split("/"))
    path = PurePosixPath(name)
    if not path.parts:
        raise ValueError("is empty")
    if "\0" in name:
        raise ValueError("holds the character 0")
    if "\\" in name or path.is_absolute() or ".." in path.parts or re.match(r"[A-Za-z]:", name):
        raise ValueError("leaves the folder")
    if any(len(os.fsencode(part)) > LONGEST for part in path.parts):
        raise ValueError("is too long")
    return path.parts


def stays(name: object) -> bool:
    """Whether ``name`` is a relative path that stays in the folder it is put in."""
    try:
        return bool(parts_of(name))
    except ValueError:
        return False


def plain(text: str) -> str:
    """A name for a file or folder that is like ``text``: no path, not hidden, of letters, digits and ``_.+-``.

    Examples
    --------
    >>> plain("my clip"), plain(".."), plain("..hidden")
    ('my_clip', 'video', 'hidden')
    """
    name = re.sub(r"[^\w.+-]+", "_", text).lstrip(".") or "video"
    if len(name.encode()) <= KEPT:
        return name
    end = "-" + hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:8]
    return name.encode()[: KEPT - len(end)].decode(errors="ignore") + end
