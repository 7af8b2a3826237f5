"""What is inside an artifact, by name: files in a folder, members of one file, or what is not written yet.

Three places, one face: the rest of the store neither knows nor asks which it is. A record is a small file
``records/NAME.json`` of a folder; one file has all its records in one. Standard library only.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, Protocol

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.records import RECORDS, recall_record, write_record

Record = Mapping[str, Any]


class Growing(Protocol):
    """A file that grows piece by piece."""

    @property
    def size(self) -> int:
        """Bytes so far."""

    @property
    def crc32(self) -> int:
        """Of what was written so far."""

    def add(self, content: bytes) -> int:
        """Write a piece; where it begins."""

    def close(self) -> None:
        """No more pieces."""


class Inside(Protocol):
    """Files and records by name; names are relative, with ``/``."""

    def record(self, name: str) -> dict[str, Any] | None:
        """A record; None where it is missing or damaged; not to be changed."""

    def has(self, name: str) -> bool:
        """Whether a record is there, in whatever state."""

    def read(self, name: str) -> bytes | None:
        """Content of a file; None where it cannot be read."""

    def read_range(self, name: str, offset: int, length: int) -> bytes | None:
        """Some bytes of a file, fewer at its end; None where it cannot be read."""

    def size(self, name: str) -> int | None:
        """Bytes of a file; None where there is none."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file."""

    def growing(self, name: str) -> Growing:
        """Write a file piece by piece."""

    def put(self, name: str, record: Record, sync: bool = False) -> None:
        """Write a record, whole or not at all; ``sync``: on the disk before its name appears."""

    def remove(self, name: str) -> None:
        """Remove a file, or a folder."""

    def drop(self, name: str) -> None:
        """Remove a record."""


@dataclass(frozen=True)
class Folder:
    """Files below ``path``."""

    path: PurePath

    def place(self, name: str) -> PurePath:
        """Where a file is: below the folder, behind no link."""
        return files.below(self.path, name)

    def record_place(self, name: str) -> PurePath:
        """Where a record is."""
        return self.place(f"{RECORDS}/{name}.json")

    def record(self, name: str) -> dict[str, Any] | None:
        """As ``Inside`` says."""
        return recall_record(self.record_place(name))

    def has(self, name: str) -> bool:
        """As ``Inside`` says."""
        return files.size(self.record_place(name)) is not None

    def read(self, name: str) -> bytes | None:
        """As ``Inside`` says; nothing is read behind a link."""
        try:
            return files.read(self.place(name))
        except StoreError:
            return None

    def read_range(self, name: str, offset: int, length: int) -> bytes | None:
        """As ``Inside`` says."""
        return files.read_range(self.place(name), offset, length)

    def size(self, name: str) -> int | None:
        """As ``Inside`` says; what is no file has none that fits."""
        return files.size(self.path / name)

    def write(self, name: str, content: bytes) -> None:
        """As ``Inside`` says."""
        files.write(self.place(name), content)

    def growing(self, name: str) -> Growing:
        """As ``Inside`` says."""
        return files.Appended(self.place(name))

    def put(self, name: str, record: Record, sync: bool = False) -> None:
        """As ``Inside`` says."""
        write_record(self.record_place(name), record, sync)

    def remove(self, name: str) -> None:
        """As ``Inside`` says."""
        files.remove(self.place(name))

    def drop(self, name: str) -> None:
        """As ``Inside`` says."""
        files.remove(self.record_place(name))


@dataclass(frozen=True)
class Reading(Folder):
    """Files below ``path`` whose records are looked up once, so that all that is read fits together.

    Most of the time that a task's reading took beside the arrays went into looking at them again.
    """

    known: dict[str, dict[str, Any]] = field(default_factory=dict, compare=False)

    def record(self, name: str) -> dict[str, Any] | None:
        """As ``Inside`` says."""
        if name not in self.known:
            found = super().record(name)
            if found is None:
                return None
            self.known[name] = found
        return self.known[name]


class _Piece(bytearray):
    """Grows in memory."""

    @property
    def size(self) -> int:
        """Bytes so far."""
        return len(self)

    @property
    def crc32(self) -> int:
        """Of what was written so far."""
        return zlib.crc32(self)

    def add(self, content: bytes) -> int:
        """As ``Growing`` says."""
        begin = len(self)
        self.extend(content)
        return begin

    def close(self) -> None:
        """As ``Growing`` says."""


@dataclass(frozen=True)
class Memory:
    """What will be one file."""

    records: dict[str, dict[str, Any]] = field(default_factory=dict)
    files: dict[str, bytes | bytearray] = field(default_factory=dict)

    def record(self, name: str) -> dict[str, Any] | None:
        """As ``Inside`` says."""
        return self.records.get(name)

    def has(self, name: str) -> bool:
        """As ``Inside`` says."""
        return name in self.records

    def read(self, name: str) -> bytes | None:
        """As ``Inside`` says."""
        found = self.files.get(name)
        return None if found is None else bytes(found)

    def read_range(self, name: str, offset: int, length: int) -> bytes | None:
        """As ``Inside`` says."""
        found = self.files.get(name)
        return None if found is None else bytes(found[offset : offset + length])

    def size(self, name: str) -> int | None:
        """As ``Inside`` says."""
        found = self.files.get(name)
        return None if found is None else len(found)

    def write(self, name: str, content: bytes) -> None:
        """As ``Inside`` says."""
        self.files[name] = content

    def growing(self, name: str) -> Growing:
        """As ``Inside`` says."""
        piece = _Piece()
        self.files[name] = piece
        return piece

    def put(self, name: str, record: Record, sync: bool = False) -> None:
        """As ``Inside`` says."""
        self.records[name] = dict(record)

    def remove(self, name: str) -> None:
        """As ``Inside`` says."""
        for known in [n for n in self.files if n == name or n.startswith(f"{name}/")]:
            del self.files[known]

    def drop(self, name: str) -> None:
        """As ``Inside`` says."""
        self.records.pop(name, None)
