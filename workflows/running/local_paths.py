"""Folders that users name for stores and outputs: local ones; a URL is refused, not made into a folder. Standard library only."""

from __future__ import annotations

import re
from pathlib import Path

from zsmoseg.errors import StoreError

_URL = re.compile(
    r"[A-Za-z][A-Za-z0-9+.-]*://|(s3|s3a|gs|gcs|az|abfs|abfss|adl|hdfs|https?|ftp|memory|file):/"
)
"""``scheme://``, or what ``Path`` leaves of it for the schemes that storage has."""


def is_url(text: str | Path) -> bool:
    """Whether this names something that is not in a local folder."""
    return _URL.match(str(text)) is not None


def local_folder(text: str | Path) -> Path:
    """The path of a folder.

    Raises
    ------
    StoreError
        If it is a URL, or no name for a file.
    """
    if is_url(text):
        raise StoreError(
            f"{text}: is a URL; stores and outputs are local folders (a mounted bucket is one), give a path"
        )
    if "\0" in str(text):
        raise StoreError(f"{str(text)!r}: holds a null byte, which no folder can have in its name")
    return Path(text)
