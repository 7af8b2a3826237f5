"""Names that come from data: which of them may become paths, and what the others are turned into.

Standard library only.
"""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from pathlib import PurePosixPath

LONGEST = 255
"""Bytes of a name, as file systems have it."""
KEPT = 120
"""Bytes that are kept of a name that is made here: endings and the names of several folders still fit."""
KINDS = {"Mn", "Mc", "So"}
"""Unicode categories that names keep besides letters and digits: marks, and symbols other than those of keyboards."""
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


def plain(text: str, tagged: bool = False) -> str:
    """A name for a file or folder that is like ``text``: no path, not hidden, of letters, digits, pictures and ``_.+-``.

    Parameters
    ----------
    tagged : tell it from others that are like the same name.

    Examples
    --------
    >>> plain("my clip"), plain(".."), plain("..hidden")
    ('my_clip', 'video', 'hidden')
    """
    told = unicodedata.normalize("NFC", text)
    name = re.sub(r"[^\w.+-]+", _like, told).lstrip(".") or "video"
    if len(name.encode()) <= KEPT and not tagged:
        return name
    end = "-" + hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:8]
    return name.encode()[: KEPT - len(end)].decode(errors="ignore") + end


def _like(other: re.Match[str]) -> str:
    """What is no letter: accents and pictures stay."""
    kept = (c if unicodedata.category(c) in KINDS else "\0" for c in other[0])
    return re.sub("\0+", "_", "".join(kept))
