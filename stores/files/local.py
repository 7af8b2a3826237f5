"""The file system of this machine, network ones included, as far as stores use it. Standard library only."""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from zsmoseg.errors import AccessError, SpaceError
from zsmoseg.remote.looks import Stat

TRIES = 5
"""Times that another process may take a name away, or give it, while a file is made."""
TMP = re.compile(r"\.(.+\.)?[0-9a-f]{32}\.tmp")
"""Names of unfinished files."""
NO_FILE = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EINVAL, errno.ENXIO, errno.ELOOP)
"""Where there is no file, or something else in its place."""
NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)
"""What file systems without hard links say."""


def absolute(path: PurePath) -> str:
    return str(Path(path).absolute())


def is_link(path: PurePath) -> bool:
    return os.path.islink(path)


@contextmanager
def _opened(path: PurePath) -> Iterator[BinaryIO]:
    """A regular file, open for reading; what waits for others (a pipe, a device) is refused, by the file that was opened.

    Raises
    ------
    OSError
        It cannot be opened, or is no regular file.
    """
    with open(path, "rb", opener=_without_waiting) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "is no regular file", os.fspath(path))
        yield file


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read(path: PurePath) -> bytes | None:
    try:
        with _opened(path) as file:
            return file.read()
    except OSError:
        return None


def closed(path: PurePath) -> str | None:
    try:
        with _opened(path) as file:
            file.read(1)
    except OSError as error:
        return None if error.errno in NO_FILE else error.strerror
    return None


def read_range(path: PurePath, offset: int, length: int) -> bytes | None:
    try:
        with _opened(path) as file:
            file.seek(offset)
            return file.read(length)
    except OSError:
        return None


def exists(path: PurePath) -> bool:
    return Path(path).exists()


def is_folder(path: PurePath) -> bool:
    return Path(path).is_dir()


def in_the_way(path: PurePath) -> PurePath | None:
    return next((p for p in (path, *path.parents) if exists(p) and not is_folder(p)), None)


def size(path: PurePath) -> int | None:
    try:
        found = os.lstat(path)
    except OSError:
        return None
    if not stat.S_ISDIR(found.st_mode):
        return found.st_size
    return sum(size(inside) or 0 for inside in Path(path).iterdir())


def _stat(found: os.stat_result) -> Stat:
    told = f"{found.st_size}-{found.st_mtime_ns}-{found.st_ctime_ns}-{found.st_ino}"
    return Stat(found.st_mtime_ns, found.st_size, told)


def stamp(path: PurePath) -> str | None:
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return _stat(found).stamp if stat.S_ISREG(found.st_mode) else None


def signature(path: PurePath) -> Stat | None:
    try:
        return _stat(os.stat(path))
    except OSError:
        return None


def listing(path: PurePath) -> Mapping[str, Stat]:
    found: dict[str, Stat] = {}
    waiting = [("", os.fspath(path))]
    while waiting:
        front, folder = waiting.pop()
        with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    waiting.append((f"{front}{entry.name}/", entry.path))
                    continue
                with suppress(FileNotFoundError):
                    found[front + entry.name] = _stat(os.lstat(entry.path))
    return found


def inside(path: PurePath) -> list[tuple[str, bool]]:
    if not os.path.isdir(path):
        return []
    with os.scandir(path) as entries:
        return sorted((entry.name, entry.is_dir()) for entry in entries if not entry.is_symlink())


def make_folder(path: PurePath) -> None:
    Path(path).mkdir(parents=True, exist_ok=True)


def touch(path: PurePath) -> None:
    os.utime(path, follow_symlinks=os.utime not in os.supports_follow_symlinks)


def zarr_store(path: PurePath) -> Any:
    from zarr.storage import LocalStore, StorePath

    return StorePath(LocalStore(Path(path), read_only=True))


def zip_store(path: PurePath) -> object:
    from zarr.storage import ZipStore

    return ZipStore(Path(path), read_only=True)


# ---------------------------------------------------------------------- leases
def create(path: PurePath, content: bytes) -> Stat | None:
    """Its name appears with its content, except on a file system that has no hard links."""
    partial = _beside(path)
    make_folder(path.parent)
    Path(partial).write_bytes(content)
    try:
        # a link fails where the name is taken, on every file system that has links, network ones too
        os.link(partial, path)
    except FileExistsError:
        # an answer that a network lost, and a request that was sent again: the link is there all the same
        return signature(path) if os.stat(partial).st_nlink > 1 else None
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        return _create_open(path, content)
    finally:
        remove(partial)
    return signature(path)


def _create_open(path: PurePath, content: bytes) -> Stat | None:
    """As ``create``; others may see it half written."""
    try:
        with open(path, "xb") as file:
            file.write(content)
    except FileExistsError:
        return None
    return signature(path)


def renew(path: PurePath, content: bytes, held: Stat) -> Stat | None:
    """By its times alone: a file that is written again would be missing, or torn, for a moment."""
    try:
        touch(path)
    except FileNotFoundError:
        return None
    return signature(path)


def take(path: PurePath, content: bytes, seen: Stat) -> Stat | None:
    """Whoever renames it first takes it, and looks at what was taken; what is another one goes back."""
    taken = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        os.rename(path, taken)
    except FileNotFoundError:
        return None
    found, old = signature(taken), read(taken)
    try:
        if found is not None and found[:2] == seen[:2]:
            return create(path, content)
        create(path, old or b"")
        return None
    finally:
        remove(taken)


# ---------------------------------------------------------------------- writing
def write(path: PurePath, content: bytes) -> None:
    with append(path) as file:
        file.write(content)


def append(path: PurePath) -> BinaryIO:
    """What has its name gives way: nothing is written into a file or link that is there."""
    for _ in range(TRIES):
        try:
            return open(path, "xb")
        except FileExistsError:
            Path(path).unlink(missing_ok=True)
        except FileNotFoundError:
            make_folder(path.parent)
    return open(path, "xb")


def _beside(path: PurePath) -> PurePath:
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")


@contextmanager
def appearing(path: PurePath) -> Iterator[Path]:
    """A file or a folder.

    Raises
    ------
    OSError
        If the disk is full or the folder closed.
    """
    partial = Path(path.with_name(f".{uuid.uuid4().hex}.tmp"))
    try:
        make_folder(path.parent)
        yield partial
        partial.replace(path)
    finally:
        remove(partial)


def write_whole(path: PurePath, content: bytes, sync: bool = False) -> None:
    """By a file beside it that takes its name.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    with errors_in_words(path), appearing(path) as partial, partial.open("xb") as file:
        file.write(content)
        if sync:
            file.flush()
            os.fsync(file.fileno())


def unlink(path: PurePath) -> None:
    Path(path).unlink(missing_ok=True)


def remove(path: PurePath) -> None:
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path, ignore_errors=True)
    else:
        unlink(path)


# ---------------------------------------------------------------------- space
def _there(path: PurePath) -> Path:
    """The folder, or the next above it that exists."""
    place = Path(path).absolute()
    return next(p for p in (place, *place.parents) if p.exists())


def free(path: PurePath) -> int:
    return shutil.disk_usage(_there(path)).free


@contextmanager
def errors_in_words(path: PurePath) -> Iterator[None]:
    """A full disk: names ``path`` and the space that is left; what names no file: ``path``, too."""
    try:
        yield
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise AccessError(
                f"{path}: a file would be larger than this process or its disk may have (ulimit -f); raise that and run the same command again"
            ) from error
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            if error.filename is None and error.errno is not None:
                error.filename = os.fspath(path)
            raise
        raise SpaceError(
            f"{path}: no space left on the disk ({free(path) / 1e6:.1f} MB free); free some, or give a place on "
            "another disk (--store for the store, -o for the output folder), and run the same command again"
        ) from error
