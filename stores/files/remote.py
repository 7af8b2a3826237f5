"""Storage behind URLs, as far as stores use it."""

from __future__ import annotations

import io
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path, PurePath
from typing import Any

from zsmoseg.remote import bucket, connection
from zsmoseg.remote.looks import Stat
from zsmoseg.remote.url import URL

SMALL = 2**24
"""Bytes of a file that grows that are kept in memory; more are put on the disk until all are there."""


def _url(path: PurePath) -> URL:
    assert isinstance(path, URL)
    return path


def read(path: PurePath) -> bytes | None:
    found = bucket.get(_url(path))
    return found[0] if found else None


def read_range(path: PurePath, offset: int, length: int) -> bytes | None:
    return bucket.get_range(_url(path), offset, length) if length else b""


def signature(path: PurePath) -> Stat | None:
    return bucket.stat(_url(path))


def stamp(path: PurePath) -> str | None:
    found = bucket.stat(_url(path))
    return found.stamp if found else None


def size(path: PurePath) -> int | None:
    found = bucket.stat(_url(path))
    if found:
        return found.size
    below = bucket.listing(_url(path))
    return sum(stat.size for stat in below.values()) if below else None


def listing(path: PurePath) -> Mapping[str, Stat]:
    return bucket.listing(_url(path))


def glance(path: URL) -> None:
    bucket.glance(path)


def inside(path: PurePath) -> list[tuple[str, bool]]:
    return bucket.inside(_url(path))


def exists(path: PurePath) -> bool:
    return bucket.stat(_url(path)) is not None or bucket.is_folder(_url(path))


def is_folder(path: PurePath) -> bool:
    return bucket.is_folder(_url(path))


def closed(path: PurePath) -> str | None:
    return None  # reading raises


def is_link(path: PurePath) -> bool:
    return False


def in_the_way(path: PurePath) -> PurePath | None:
    return None


def absolute(path: PurePath) -> str:
    return str(path)


def make_folder(path: PurePath) -> None:
    return


def touch(path: PurePath) -> None:
    return


def write(path: PurePath, content: bytes) -> None:
    bucket.put(_url(path), content)


def write_whole(path: PurePath, content: bytes, sync: bool = False) -> None:
    bucket.put(_url(path), content)


class _Growing:
    """Bytes that become a file when it is closed."""

    def __init__(self, url: URL) -> None:
        self._url, self._file = url, tempfile.SpooledTemporaryFile(SMALL)  # noqa: SIM115

    def write(self, content: bytes) -> None:
        self._file.write(content)

    def close(self) -> None:
        with self._file:
            self._file.seek(0)
            bucket.put(self._url, self._file)


def append(path: PurePath) -> _Growing:
    return _Growing(_url(path))


@contextmanager
def appearing(path: PurePath) -> Iterator[Path]:
    folder = tempfile.mkdtemp(prefix="zsmoseg-")
    try:
        partial = Path(folder) / path.name
        yield partial
        bucket.put(_url(path), partial)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def unlink(path: PurePath) -> None:
    bucket.unlink(_url(path))


def remove(path: PurePath) -> None:
    bucket.delete(_url(path))


def create(path: PurePath, content: bytes) -> Stat | None:
    return bucket.put_if(_url(path), content, None)


def renew(path: PurePath, content: bytes, held: Stat) -> Stat | None:
    return bucket.put_if(_url(path), content, held.stamp)


def take(path: PurePath, content: bytes, seen: Stat) -> Stat | None:
    return bucket.put_if(_url(path), content, seen.stamp)


def zarr_store(path: PurePath) -> Any:
    from zarr.storage import ObjectStore, StorePath

    url = _url(path)
    return StorePath(ObjectStore(connection.of(url)), url.key)


def zip_store(path: PurePath) -> Any:
    from zarr.core.buffer import Buffer, cpu
    from zarr.storage import MemoryStore

    with zipfile.ZipFile(io.BytesIO(read(path) or b"")) as found:
        members: dict[str, Buffer] = {
            name: cpu.Buffer.from_bytes(found.read(name)) for name in found.namelist()
        }
    return MemoryStore(members, read_only=True)


def errors_in_words(path: PurePath) -> AbstractContextManager[None]:
    return connection.errors_in_words(_url(path))


def free(path: PurePath) -> int | None:
    return None
