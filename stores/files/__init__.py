"""Storage, as far as stores use it: a path is local, a URL remote, and nobody else asks which.

What the two kinds do is said in ``storage``; here is what follows from that for both.
"""

from __future__ import annotations

import os
import re
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import Any, TypeVar

from zsmoseg.errors import StoreError, ZsmosegError
from zsmoseg.remote.looks import Stat as Stat
from zsmoseg.remote.looks import no_look as no_look
from zsmoseg.remote.looks import one_look as one_look
from zsmoseg.remote.url import URL
from zsmoseg.remote.url import folder as folder
from zsmoseg.stores.files import local, remote
from zsmoseg.stores.files.local import TMP as TMP
from zsmoseg.stores.files.storage import Growing, Storage
from zsmoseg.video.plain_names import parts_of

P = TypeVar("P", bound=PurePath)
STALE = 3600.0
"""Seconds after which an unfinished file is a leftover of a process that is gone."""
LEASE = re.compile(r"(?:\.zsmoseg|[0-9A-Za-z_-]+\.(?:begin|seal|\d{4,}))\.lease")
"""Names of leases: of an output folder, of work on an artifact."""
SHOWN = 80
"""Characters of a name in an error."""


def on(path: PurePath) -> Storage:
    """The storage that has a path."""
    return remote if isinstance(path, URL) else local


def below(root: P, name: object, error: type[ZsmosegError] = StoreError, *, one: bool = False) -> P:
    """The path of ``name`` below ``root``: the only way from a name that comes from data to a path.

    What lies above ``root``, and ``root`` itself, may be links: whoever named it chose them.

    Parameters
    ----------
    name
        A relative path with ``/``.
    error
        What is raised.
    one
        Whether it has to be one file or folder in ``root``.

    Raises
    ------
    ZsmosegError
        If the name leaves ``root`` or is no name, or a part of the path below ``root`` is a link: we make none.
    """
    try:
        parts = parts_of(name)
        if one and len(parts) > 1:
            raise ValueError("has a /")
    except ValueError as why:
        shown = name[:SHOWN] if isinstance(name, str) else name
        raise error(f"{root}: the name {shown!r} {why}; nothing is read or written there") from why
    if isinstance(root, URL):
        return root.joinpath(*parts)
    path = str(root)
    for part in parts:
        path = os.path.join(path, part)
        if os.path.islink(path):
            raise error(f"{path}: is a link, and zsmoseg makes and follows none here; remove it")
    return type(root)(path)


@contextmanager
def looking_at(*folders: PurePath) -> Iterator[None]:
    """Within the block this thread asks for no file below ``folders`` again: of a URL one listing tells it all.

    What this thread writes or removes meanwhile it knows; leases, and what is done while one is held, look anew.
    """
    with one_look():
        for folder in filter(is_remote, folders):
            listing(folder)
        yield


@contextmanager
def glancing_at(path: PurePath) -> Iterator[None]:
    """As ``looking_at``, for a task that needs little of what may be much: where one request does not list all of a folder,
    this thread asks file by file, for each once.
    """
    with one_look():
        if isinstance(path, URL):
            remote.glance(path)
        yield


def is_remote(path: PurePath) -> bool:
    """Whether each question is a request to a server."""
    return isinstance(path, URL)


def read(path: PurePath) -> bytes | None:
    """Content of a file; None where there is none."""
    return on(path).read(path)


def read_range(path: PurePath, offset: int, length: int) -> bytes | None:
    """``length`` bytes of a file from ``offset`` on, fewer at its end; None where there is none."""
    return on(path).read_range(path, offset, length)


def exists(path: PurePath) -> bool:
    """Whether there is a file or a folder."""
    return on(path).exists(path)


def is_folder(path: PurePath) -> bool:
    """Whether there is a folder."""
    return on(path).is_folder(path)


def closed(path: PurePath) -> str | None:
    """Why a file that is there cannot be read, in the system's words; None where it can be, or there is none."""
    return on(path).closed(path)


def is_link(path: PurePath) -> bool:
    """Whether there is a symbolic link."""
    return on(path).is_link(path)


def in_the_way(path: PurePath) -> PurePath | None:
    """A file that has the name of the folder ``path``, or of one above."""
    return on(path).in_the_way(path)


def absolute(path: PurePath) -> str:
    """The path as records remember it, wherever who reads them stands."""
    return on(path).absolute(path)


def free(path: PurePath) -> int | None:
    """Bytes that can still be written; None where nobody knows."""
    return on(path).free(path)


def size(path: PurePath) -> int | None:
    """Size of a file in bytes, or of all files below a folder; None where there is nothing.

    Of a link it is that of the link.
    """
    return on(path).size(path)


def stamp(path: PurePath) -> str | None:
    """What changes whenever a file is written, moved or touched; None where there is none, or a link."""
    return on(path).stamp(path)


def signature(path: PurePath) -> Stat | None:
    """What changes when a file is written again; None where there is none."""
    return on(path).signature(path)


def listing(path: PurePath) -> Mapping[str, Stat]:
    """Every file below a folder, by relative path; links are files, and not followed. One request for a URL."""
    return on(path).listing(path)


def crc32(content: bytes) -> int:
    """Checksum of a file for its record.

    Not CRC-32C: Zarr ends every chunk with that of the chunk, and the CRC-32C of such a file depends on the
    lengths of its chunks only, so another file of the same lengths would pass.
    """
    return zlib.crc32(content)


def folders(path: P) -> list[P]:
    """The folders in a folder, in order of their names; none where there is no folder. Links are none."""
    return [path / name for name, is_one in on(path).inside(path) if is_one]


def inside(path: P) -> list[P]:
    """Files and folders in a folder, in order of their names; no links."""
    return [path / name for name, _ in on(path).inside(path)]


def matching(path: P, pattern: str) -> list[P]:
    """What is in a folder and has a name like ``pattern``, in order of the names; no links."""
    return [path / name for name, _ in on(path).inside(path) if fnmatchcase(name, pattern)]


def tree(path: PurePath) -> list[str]:
    """What is below a folder, by relative path: files and links, which are not followed; no unfinished files."""
    return sorted(name for name in listing(path) if not TMP.fullmatch(name.rpartition("/")[2]))


def make_folder(path: PurePath) -> None:
    """Make a folder, and those above it."""
    on(path).make_folder(path)


def touch(path: PurePath) -> None:
    """Note that a file is used now, where that can be noted without writing it again."""
    on(path).touch(path)


def zarr_store(path: PurePath) -> Any:
    """What Zarr and xarray open as the group or array in a folder."""
    return on(path).zarr_store(path)


def zip_store(path: PurePath) -> Any:
    """What Zarr and xarray open as the group in a zip."""
    return on(path).zip_store(path)


def create(path: PurePath, content: bytes) -> Stat | None:
    """Write a small file that is not there yet; None if it is. ``content`` has to be nobody else's."""
    return on(path).create(path, content)


def renew(path: PurePath, content: bytes, held: Stat) -> Stat | None:
    """Say once more that a file is ours; None if it is not as it was ``held`` any more.

    Parameters
    ----------
    content
        Another than before: on a server times are too coarse to show that a file was written again.
    """
    return on(path).renew(path, content, held)


def take(path: PurePath, content: bytes, seen: Stat) -> Stat | None:
    """Put ``content`` in the place of the file that was ``seen``; None if somebody was faster."""
    return on(path).take(path, content, seen)


def write(path: PurePath, content: bytes) -> None:
    """Write a file, and its folders. For files that count for nothing before a record names them."""
    on(path).write(path, content)


def write_whole(path: PurePath, content: bytes, sync: bool = False) -> None:
    """Write a file that appears whole or not at all; ``sync``: on the disk before its name appears.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    on(path).write_whole(path, content, sync)


def appearing(path: PurePath) -> AbstractContextManager[Path]:
    """A local path to write a file to; at the end that takes the place of ``path``, after an error it is removed.

    Of a local ``path`` a folder may be written, too.
    """
    return on(path).appearing(path)


class Appended:
    """A file that grows piece by piece; for files that count for nothing before a record names them.

    Attributes
    ----------
    path, size, crc32
        Of what was written so far.
    """

    def __init__(self, path: PurePath) -> None:
        self.path, self.size, self.crc32 = path, 0, 0
        self._file: Growing | None = None

    def add(self, content: bytes) -> int:
        """Write a piece; where it begins."""
        if self._file is None:
            self._file = on(self.path).append(self.path)
        self._file.write(content)
        begin, self.size = self.size, self.size + len(content)
        self.crc32 = zlib.crc32(content, self.crc32)
        return begin

    def close(self) -> None:
        """No more pieces; the file is there."""
        if self._file is not None:
            file, self._file = self._file, None
            file.close()


def entry(path: PurePath) -> dict[str, int]:
    """Size and checksum of a file that is there, for a record."""
    content = read(path) or b""
    return {"size": len(content), "crc32": crc32(content)}


def noted(path: PurePath, content: bytes | None = None) -> dict[str, Any]:
    """Size, checksum and stamp of a file that is finished; ``content``: what it has to hold, else what it holds."""
    found = (read(path) or b"") if content is None else content
    return {"size": len(found), "crc32": crc32(found), "stamp": stamp(path)}


def write_noted(path: PurePath, content: bytes) -> dict[str, Any]:
    """``write_whole``, then ``noted``."""
    write_whole(path, content)
    return noted(path, content)


def unlink(path: PurePath) -> None:
    """Remove a file, if it is there; of a URL with one request less than ``remove``."""
    on(path).unlink(path)


def remove(path: PurePath) -> None:
    """Remove a file or a folder with all that is in it, if it is there."""
    on(path).remove(path)


def is_ours(name: str, leases: bool = False) -> bool:
    """Whether a file has a name that only zsmoseg gives, to a lease or (unless ``leases``) to what is unfinished."""
    last = name.rpartition("/")[2]
    return LEASE.fullmatch(last) is not None or (not leases and TMP.fullmatch(last) is not None)


def leftovers(path: PurePath, everywhere: bool = True) -> list[PurePath]:
    """Unfinished files and leases in a folder (and below it: ``everywhere``) that are old enough to be nobody's."""
    oldest = (time.time() - STALE) * 1e9
    names = listing(path) if everywhere else [name for name, is_one in on(path).inside(path) if not is_one]
    left = [path / name for name in names if is_ours(name)]
    return sorted(
        file for file in left if not is_link(file) and (seen := signature(file)) and seen.modified < oldest
    )


def errors_in_words(path: PurePath) -> AbstractContextManager[None]:
    """Around writing: what others raise about storage becomes an ``OSError``, a full disk a ``SpaceError`` with the
    space that is left.
    """
    return on(path).errors_in_words(path)
