"""What users name: a local path, or a URL, which is a path too. Standard library only."""

from __future__ import annotations

import re
from os import PathLike, fspath
from pathlib import Path, PurePath, PurePosixPath
from typing import Any
from urllib.parse import unquote

from zsmoseg.errors import SettingsError, StoreError, ZsmosegError

WRITABLE = ("s3", "gs", "az", "memory")
"""Schemes of what can be listed and written."""
READABLE = ("https", "http")
"""Schemes of what can only be read, and only by its full name."""
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_NEARLY = re.compile(r"(s3|s3a|gs|gcs|az|abfs|abfss|adl|hdfs|https?|ftp|memory|file):/", re.IGNORECASE)
"""What ``Path`` leaves of a URL, for the schemes that storage has."""
_ONE_SLASH = re.compile(rf"({'|'.join(WRITABLE + READABLE)}):/(?!/)")


class URL(PurePosixPath):
    """A URL as a path without a file system: its first parts are the scheme and the bucket or host.

    What is made from it with ``/``, ``parent``, ``with_name`` is one too. Nothing of the system takes it for a file.

    Examples
    --------
    >>> clip = URL("s3://bucket/films/goat.mp4")
    >>> str(clip.parent / "camel.mp4"), clip.stem, str(clip.relative_to(clip.parent))
    ('s3://bucket/films/camel.mp4', 'goat', 'goat.mp4')
    """

    def __str__(self) -> str:
        return _ONE_SLASH.sub(r"\1://", super().__str__(), count=1)

    def __fspath__(self) -> str:
        raise TypeError(f"{self} is no file of this machine")

    @property
    def scheme(self) -> str:
        """``s3`` of ``s3://bucket/key``."""
        return self.parts[0].rstrip(":")

    @property
    def bucket(self) -> str:
        """``bucket`` of ``s3://bucket/key``."""
        return self.parts[1]

    @property
    def key(self) -> str:
        """``key`` of ``s3://bucket/key``; empty for the bucket itself."""
        return "/".join(self.parts[2:])


def is_url(text: str | PurePath) -> bool:
    """Whether this names something that is not in a local folder."""
    return isinstance(text, URL) or _SCHEME.match(str(text)) is not None


def place(text: str | PurePath, error: type[ZsmosegError] = StoreError) -> Path | URL:
    """What a text names: a path, or a URL of storage that is known.

    Raises
    ------
    ZsmosegError
        ``error``: no name for a file; a URL of another kind; one that holds a secret, which is not repeated.
    """
    if isinstance(text, URL):
        return text
    told = str(text)
    if "\0" in told:
        raise error(f"{told!r}: holds a null byte, which no folder can have in its name")
    found = _SCHEME.match(told)
    if not found:
        if _NEARLY.match(told):
            raise error(f"{_open(told)}: looks like a URL; write it with two slashes, as s3://bucket/name")
        return Path(text)
    scheme = found[1].lower()
    host, _, rest = told[found.end() :].partition("/")
    _refuse_secrets(told, scheme, host, error)
    if scheme == "file" and host in ("", "localhost"):
        return Path(f"/{rest}")
    if scheme not in WRITABLE + READABLE:
        raise error(
            f"{_open(told)}: is a URL of a kind that is not known; there are {', '.join(WRITABLE)}, https, file"
        )
    rest = unquote(rest) if scheme in READABLE else rest
    if not host or ".." in rest.split("/") or "\0" in rest:
        raise error(f"{_open(told)}: is no URL of a folder or file; write it as {scheme}://bucket/name")
    return URL(f"{scheme}:/{host}/{rest}")


def given_path(value: Any, name: str) -> str | PurePath:
    """What a caller in Python gave for the argument ``name``, where a path or a URL is meant.

    Raises
    ------
    SettingsError
        It is neither text nor a path: bytes, None, a list, an array.
    """
    found = value if isinstance(value, PurePath) or not isinstance(value, PathLike) else fspath(value)
    if not isinstance(found, str | PurePath):
        raise SettingsError(
            f"{name} is of type {type(value).__name__}; give one path or URL, as text or pathlib.Path"
        )
    return found


def folder(text: str | PurePath) -> Path | URL:
    """Where a store or an output folder is to be: as ``place``, but what can be written, and no whole bucket."""
    found = place(text)
    if isinstance(found, URL):
        if found.scheme not in WRITABLE:
            raise StoreError(
                f"{found}: can only be read; stores and outputs go to {', '.join(WRITABLE)} or a path"
            )
        if not found.key:
            raise StoreError(f"{found}: is a whole bucket; give a folder in it, as {found}/name")
    return found


def local_folder(text: str | PurePath) -> Path:
    """A path; a URL is refused."""
    found = place(text)
    if isinstance(found, URL):
        raise StoreError(f"{found}: is a URL; this is written to local files, give a path")
    return found


def _refuse_secrets(told: str, scheme: str, host: str, error: type[ZsmosegError]) -> None:
    """Names and passwords, signatures and tokens would end in records and on screens."""
    query = re.search(r"[?#]" if scheme in READABLE else r"[?#].*=", told)
    if "@" in host or query:
        raise error(
            f"{_open(told)}: holds a name, password, token or query; zsmoseg keeps no secrets, so give the bare URL and "
            "the credentials in the environment (AWS_*, GOOGLE_*, AZURE_*)"
        )


def _open(told: str) -> str:
    """Of a URL what is no secret."""
    return re.sub(r"(:/+)[^/]*@", r"\1", re.split(r"[?#]", told)[0])
