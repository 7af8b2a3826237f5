"""The file system, as far as stores use it: the one place to teach another kind of storage.

Standard library only.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import time
import uuid
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from zsmoseg.errors import SpaceError, StoreError, ZsmosegError
from zsmoseg.video.plain_names import parts_of

SHOWN = 80
"""Characters of a name in an error."""
TRIES = 5
"""Times that another process may take a name away, or give it, while a file is made."""
STALE = 3600.0
"""Seconds after which an unfinished file is a leftover of a process that is gone."""


TMP = re.compile(r"\.(.+\.)?[0-9a-f]{32}\.tmp")
"""Names of unfinished files."""


def below(root: Path, name: object, error: type[ZsmosegError] = StoreError, *, one: bool = False) -> Path:
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
    path = str(root)
    for part in parts:
        path = os.path.join(path, part)
        if os.path.islink(path):
            raise error(f"{path}: is a link, and zsmoseg makes and follows none here; remove it")
    return Path(path)


def absolute(path: Path) -> str:
    """The path from the root of the file system, as records remember it."""
    return str(path.absolute())


def is_link(path: Path) -> bool:
    """Whether there is a symbolic link."""
    return os.path.islink(path)


def read(path: Path) -> bytes | None:
    """Content of a file; None where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError:
        return None


def read_range(path: Path, offset: int, length: int) -> bytes | None:
    """``length`` bytes of a file from ``offset`` on, fewer at its end; None where it cannot be read."""
    try:
        with path.open("rb") as file:
            file.seek(offset)
            return file.read(length)
    except OSError:
        return None


def exists(path: Path) -> bool:
    """Whether there is a file or a folder."""
    return path.exists()


def is_folder(path: Path) -> bool:
    """Whether there is a folder."""
    return path.is_dir()


def size(path: Path) -> int | None:
    """Size of a file in bytes, or of all files below a folder; None where there is nothing.

    Of a link it is that of the link.
    """
    try:
        found = path.lstat()
    except OSError:
        return None
    if not stat.S_ISDIR(found.st_mode):
        return found.st_size
    return sum(size(inside) or 0 for inside in path.iterdir())


def stamp(path: Path) -> str | None:
    """Size of a file, and what changes whenever it is written, moved or touched; None where there is none, or a link."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    return f"{found.st_size}-{found.st_mtime_ns}-{found.st_ctime_ns}-{found.st_ino}"


def crc32(content: bytes) -> int:
    """Checksum of a file for its record.

    Not CRC-32C: Zarr ends every chunk with that of the chunk, and the CRC-32C of such a file depends on the
    lengths of its chunks only, so another file of the same lengths would pass.
    """
    return zlib.crc32(content)


def signature(path: Path) -> tuple[int, int, int] | None:
    """What changes when a file is written again; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


def folders(path: Path) -> list[Path]:
    """The folders in a folder, in order of their names; none where there is no folder. Links are none."""
    if not path.is_dir():
        return []
    return sorted(inside for inside in path.iterdir() if inside.is_dir() and not inside.is_symlink())


def matching(path: Path, pattern: str) -> list[Path]:
    """What is in a folder and has a name like ``pattern``, in order of the names; no links."""
    return sorted(inside for inside in path.glob(pattern) if not inside.is_symlink())


def inside(path: Path) -> list[Path]:
    """Files and folders in a folder, in order of their names."""
    return sorted(path.iterdir()) if path.is_dir() else []


def tree(path: Path) -> list[str]:
    """What is below a folder, by relative path: files and links, which are not followed; no unfinished files."""
    found = []
    for folder, folders, names in os.walk(path):
        links = [name for name in folders if os.path.islink(os.path.join(folder, name))]
        for name in [*names, *links]:
            if not TMP.fullmatch(name):
                found.append((Path(folder) / name).relative_to(path).as_posix())
    return sorted(found)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it."""
    path.mkdir(parents=True, exist_ok=True)


def touch(path: Path) -> None:
    """Note that a file is used now."""
    os.utime(path, follow_symlinks=False)


def zarr_store(path: Path) -> Any:
    """What Zarr and xarray open as the group or array in a folder."""
    return str(path)


def create(path: Path, content: bytes) -> bool:
    """Write a small file that is not there yet; whether this call made it. Its name appears with its content."""
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial.write_bytes(content)
    try:
        # a link fails where the name is taken, on every file system that has links, network ones too
        os.link(partial, path)
    except FileExistsError:
        return False
    finally:
        remove(partial)
    return True


def move(path: Path, to: Path) -> bool:
    """Give a file another name; whether it was there."""
    try:
        path.rename(to)
    except FileNotFoundError:
        return False
    return True


def write(path: Path, content: bytes) -> None:
    """Write a file, and its folders. For files that count for nothing before a record names them."""
    with _made(path) as file:
        file.write(content)


def _made(path: Path) -> BinaryIO:
    """A file to write; what has its name gives way: nothing is written into a file or link that is there."""
    for _ in range(TRIES):
        try:
            return path.open("xb")
        except FileExistsError:
            path.unlink(missing_ok=True)
        except FileNotFoundError:
            path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("xb")


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """A path to write a file or folder to; at the end it takes the name ``path``, after an error it is removed.

    Raises
    ------
    OSError
        If the disk is full or the folder closed.
    """
    partial = path.with_name(f".{uuid.uuid4().hex}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(path)
    finally:
        remove(partial)


def write_whole(path: Path, content: bytes, sync: bool = False) -> None:
    """Write a file that appears whole or not at all; ``sync``: on the disk before its name appears.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    with full_disk_in_words(path), appearing(path) as partial, partial.open("xb") as file:
        file.write(content)
        if sync:
            file.flush()
            os.fsync(file.fileno())


class Appended:
    """A file that grows piece by piece; for files that count for nothing before a record names them.

    Attributes
    ----------
    path, size, crc32
        Of what was written so far.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.size, self.crc32 = path, 0, 0
        self._file: BinaryIO | None = None

    def add(self, content: bytes) -> int:
        """Write a piece; where it begins."""
        if self._file is None:
            self._file = _made(self.path)
        self._file.write(content)
        begin, self.size = self.size, self.size + len(content)
        self.crc32 = zlib.crc32(content, self.crc32)
        return begin

    def close(self) -> None:
        """No more pieces."""
        if self._file is not None:
            self._file.close()
            self._file = None


def entry(path: Path) -> dict[str, int]:
    """Size and checksum of a file, for a record."""
    content = path.read_bytes()
    return {"size": len(content), "crc32": crc32(content)}


def noted(path: Path, content: bytes | None = None) -> dict[str, Any]:
    """Size, checksum and stamp of a file that is finished; ``content``: what it has to hold, else what it holds."""
    found = path.read_bytes() if content is None else content
    return {"size": len(found), "crc32": crc32(found), "stamp": stamp(path)}


def write_noted(path: Path, content: bytes) -> dict[str, Any]:
    """``write_whole``, then ``noted``."""
    write_whole(path, content)
    return noted(path, content)


def remove(path: Path) -> None:
    """Remove a file or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def leftovers(path: Path, everywhere: bool = True) -> list[Path]:
    """Unfinished files and leases in a folder (and below it: ``everywhere``) that are old enough to be nobody's."""
    oldest = time.time() - STALE
    walk = path.rglob if everywhere else path.glob
    found = [
        file for end in ("partial", "tmp", "lease") for file in walk(f"*.{end}") if not file.is_symlink()
    ]
    old = [file for file in found if (seen := signature(file)) and seen[0] / 1e9 < oldest]
    return sorted(file for file in old if file.is_file())


@contextmanager
def full_disk_in_words(path: Path) -> Iterator[None]:
    """Turn "no space left" into a ``SpaceError`` that names ``path`` and the space that is left."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        place = next(p for p in (path.absolute(), *path.absolute().parents) if p.exists())
        free = shutil.disk_usage(place).free / 1e6
        raise SpaceError(
            f"{path}: no space left on the disk ({free:.1f} MB free); free some, or give a store on another "
            "disk (--store), and run the same command again"
        ) from error
