"""An artifact of a short video as one file: a Zarr v3 group in an uncompressed zip, which Zarr's ``ZipStore`` opens.

The last member, ``records/artifact.json``, holds all records, and says where each other member begins; the comment of the
zip says where that one is, with a checksum of the directory that others go by: a name that changed there would read as
fill value. So one read of the end of the file tells all, and one more brings any table. The file is written once, whole or
not at all. Standard library only.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.inside import Growing, Memory, Record
from zsmoseg.stores.records import trusted, vouched

RECORD = "records/artifact.json"
_COMMENT = "{:012d} {:012d} {:012d} {:010d}"
_COMMENT_BYTES = 49
_HEADER = 30
"""Bytes before the name of a member."""
_SMALL = 2**20
"""Bytes of a file that is read at once, and kept as long as its record is."""
_TAIL = 2**16
"""Bytes that are read from the end of others: the record of a short video and the directory behind it are in it."""


def encode(path: PurePath, memory: Memory) -> bytes:
    """The file of what is in ``memory``, for the place ``path``: the same bytes whenever it is made."""
    members: dict[str, list[int]] = {}
    begin = 0
    for name in sorted(memory.files):
        content = memory.files[name]
        begin += _HEADER + len(name.encode())
        members[name] = [begin, len(content), zlib.crc32(content)]
        begin += len(content)
    record = vouched(path, {"members": members, "records": memory.records})
    return _zip({name: memory.files[name] for name in members}, record)


def _zip(members: Mapping[str, bytes | bytearray], record: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content)  # of 1980, whenever it is made
        info = zipfile.ZipInfo(RECORD)
        archive.writestr(info, record)
        archive.comment = b" " * _COMMENT_BYTES
    whole = stream.getvalue()
    where = info.header_offset + _HEADER + len(RECORD)
    directory = zlib.crc32(whole[where + len(record) : -_COMMENT_BYTES])
    return whole[:-_COMMENT_BYTES] + _COMMENT.format(where, len(record), len(whole), directory).encode()


@dataclass(frozen=True)
class Archive:
    """The members of the file ``path``: offset, size and CRC-32 of each; ``text`` is the record that says so.

    ``whole`` is all of a small file: one request instead of one a table.
    """

    path: PurePath
    members: Mapping[str, tuple[int, int, int]]
    records: Mapping[str, dict[str, Any]]
    text: bytes
    whole: bytes | None = None

    def record(self, name: str) -> dict[str, Any] | None:
        """As ``Inside`` says."""
        return self.records.get(name)

    def has(self, name: str) -> bool:
        """As ``Inside`` says."""
        return name in self.records

    def read(self, name: str) -> bytes | None:
        """As ``Inside`` says."""
        return self.read_range(name, 0, self.members[name][1]) if name in self.members else None

    def read_range(self, name: str, offset: int, length: int) -> bytes | None:
        """As ``Inside`` says."""
        if name not in self.members:
            return None
        begin, size, _ = self.members[name]
        if self.whole is not None:
            return self.whole[begin + offset : begin + min(offset + length, size)]
        return files.read_range(self.path, begin + offset, max(min(length, size - offset), 0))

    def size(self, name: str) -> int | None:
        """As ``Inside`` says."""
        return self.members[name][1] if name in self.members else None

    def write(self, name: str, content: bytes) -> None:
        """Never: it was written once."""
        raise self._written()

    def growing(self, name: str) -> Growing:
        """Never: it was written once."""
        raise self._written()

    def put(self, name: str, record: Record, sync: bool = False) -> None:
        """Never: it was written once."""
        raise self._written()

    def remove(self, name: str) -> None:
        """Never: it was written once."""
        raise self._written()

    def drop(self, name: str) -> None:
        """Never: it was written once."""
        raise self._written()

    def _written(self) -> RuntimeError:
        return RuntimeError(f"{self.path}: is written once and for all")


def recall(path: PurePath) -> Archive | None:
    """The archive; None where there is none, or its record is damaged. Read once while the file stays the same."""
    stamp = files.stamp(path)
    return None if stamp is None else _read(path, stamp)


@lru_cache(maxsize=64)
def _read(path: PurePath, stamp: str) -> Archive | None:
    size = files.size(path) or 0
    begin = 0 if size <= _SMALL else size - _TAIL
    tail = files.read_range(path, begin, size - begin) or b""
    try:
        where, length, whole, directory = map(int, tail[-_COMMENT_BYTES:].split())
    except ValueError:
        return None
    if whole != size or not 0 <= where <= where + length <= size:
        return None
    rest = tail[where - begin :] if where >= begin else files.read_range(path, where, size - where) or b""
    text = rest[:length]
    found = trusted(path, text)
    if found is None or zlib.crc32(rest[length:-_COMMENT_BYTES]) != directory:
        return None
    return Archive(
        path,
        {name: tuple(at) for name, at in found["members"].items()},
        found["records"],
        text,
        tail if begin == 0 else None,
    )


def differs(path: PurePath, found: Archive) -> bool:
    """Whether a byte of the file is not as it was written; all of it is read."""
    content = files.read(path)
    if content is None:
        return True
    members = {name: content[at : at + size] for name, (at, size, _) in found.members.items()}
    wrong = any(zlib.crc32(members[name]) != crc for name, (_, _, crc) in found.members.items())
    return wrong or content != _zip(members, found.text)
