"""One artifact: what one stage left of one video with one key. It is a Zarr v3 group that xarray opens.

    KEY/                        a folder, of a video of several chunks
      zarr.json                 written when all is there: the metadata of all arrays in one file
      forward/, valid/, ...     the arrays: of video arrays one shard a part; tables joined when all parts are there
      records/artifact.json     stage, version, settings, keys of inputs, how it is cut, its video arrays
      records/0003.tables       what part 3 found out, as it was written; stages read this
      records/0003.json         written when part 3 is whole: its files, their sizes and checksums
      records/done.json         written last: all parts are there; it takes their records in
    KEY.zip                     the same of a video of one chunk, written at once (``stores/archive.py``)

Existence is the record, never the bytes: a shard that is missing or empty would read as fill value. Looking at
records imports the standard library only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import PurePath
from typing import Any

from zsmoseg.stores import archive, files
from zsmoseg.stores.inside import Folder, Inside, Reading
from zsmoseg.stores.records import ARCHIVE, RECORDS

AGAIN = "run the same command again"
ABOUT, DONE = "artifact", "done"
"""Names of its first and its last record."""


@dataclass(frozen=True)
class TableEntry:
    """Where a table lies in the file of its part, and what it is."""

    dtype: str
    shape: Sequence[int]
    offset: int
    length: int
    crc32: int


@dataclass(frozen=True)
class Block:
    """What was written at once of a part: tables of the frames ``start`` to ``stop - 1``."""

    part: int
    start: int
    stop: int
    tables: Mapping[str, TableEntry]


@dataclass(frozen=True)
class PartRecord:
    """What a finished part left.

    Attributes
    ----------
    start, stop
        Its frames.
    files
        ``size`` and ``crc32`` of each file, by path relative to the artifact.
    blocks
        ``start``, ``stop`` and ``tables`` of each block, in order; see ``Artifact.blocks``.
    facts
        What the task noted.
    """

    start: int
    stop: int
    files: Mapping[str, Mapping[str, int]]
    blocks: Sequence[Mapping[str, Any]]
    facts: Mapping[str, Any]

    @property
    def seconds(self) -> float:
        """How long the task took."""
        return float(self.facts.get("seconds", 0.0))


_FIELDS = {field.name for field in fields(PartRecord)}


def chunk_name(row: int, dimensions: int) -> str:
    """The file of a chunk that is cut along the first dimension only: beside ``zarr.json``, as folders cost more."""
    return "c" + f".{row}" * min(dimensions, 1) + ".0" * max(dimensions - 1, 0)


@dataclass(frozen=True)
class Artifact:
    """The artifact in the folder ``path`` = ``STORE/VIDEO/STAGE/KEY``, or the file beside it; it need not exist yet.

    ``held`` is what is inside, where that is known: what will be one file, or one file that is read many times.
    """

    path: PurePath
    held: Inside | None = None

    @property
    def archive(self) -> PurePath:
        """The one file of a short video."""
        return self.path.with_name(self.path.name + ARCHIVE)

    @property
    def inside(self) -> Inside:
        """Its files and records."""
        return self.held or archive.recall(self.archive) or Folder(self.path)

    @property
    def for_reading(self) -> Artifact:
        """The same, its records looked up once."""
        return self if self.held else replace(self, held=archive.recall(self.archive) or Reading(self.path))

    @property
    def packed(self) -> bool:
        """Whether it is one file, in whatever state."""
        return files.stamp(self.archive) is not None

    @property
    def exists(self) -> bool:
        """Whether anything is there, in whatever state."""
        return self.packed or Folder(self.path).has(ABOUT)

    @property
    def laid_out(self) -> dict[str, Any]:
        """All of ``artifact.json``, empty where there is nothing or it is damaged; not to be changed."""
        return self.inside.record(ABOUT) or {}

    @property
    def description(self) -> dict[str, Any] | None:
        """What it was begun with, and ``parts``; None where there is nothing, or it is damaged."""
        told = {name: value for name, value in self.laid_out.items() if name != "arrays"}
        return told or None

    @property
    def parts(self) -> list[tuple[int, int]]:
        """The frames (start, stop) of each part; empty where there is no description."""
        return [(start, stop) for start, stop in self.laid_out.get("parts", [])]

    @property
    def arrays(self) -> dict[str, dict[str, Any]]:
        """The video arrays by name: the fields of their ``ArraySpec``."""
        return dict(self.laid_out.get("arrays", {}))

    @property
    def done(self) -> dict[str, Any] | None:
        """The last record; None until all is there."""
        return self.inside.record(DONE)

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a video array."""
        return tuple(self.laid_out["arrays"][name]["shape"])

    # ------------------------------------------------------------------ parts
    def lease_path(self, work: str) -> PurePath:
        """Who does some work on it: a part, by the name of its record, or its beginning or sealing."""
        return self.path.with_name(f"{self.path.name}.{work}.lease")

    def shard(self, name: str, part: int) -> str:
        """The file that holds a part of a video array."""
        dimensions = len(self.laid_out["arrays"][name]["dims"])
        return f"{name}/{chunk_name(part, dimensions)}"

    def part_record(self, part: int) -> dict[str, Any] | None:
        """The record of a part as it was written; None where it is missing or damaged."""
        inside, name = self.inside, part_name(part)
        # in this order: a part that is taken in meanwhile is first in both
        for found in (_taken_in(inside, name), inside.record(name), _taken_in(inside, name)):
            if found is not None and found.keys() == _FIELDS:
                return found
        return None

    def part(self, part: int) -> PartRecord | None:
        """The record of a part; None where it is missing or damaged."""
        found = self.part_record(part)
        return PartRecord(**found) if found else None

    def blocks(self, part: int) -> Iterator[Block]:
        """The blocks of a finished part, in order; none where its record is missing."""
        record = self.part(part)
        for block in record.blocks if record else ():
            tables = {name: TableEntry(*entry) for name, entry in block["tables"].items()}
            yield Block(part, block["start"], block["stop"], tables)

    @property
    def written(self) -> int:
        """How many parts have a record; none is read."""
        if self.packed or Folder(self.path).has(DONE):
            return len(self.parts)
        return len(files.matching(self.path / RECORDS, "[0-9]*.json"))

    # ------------------------------------------------------------------ taking back, neighbours
    def unseal(self) -> None:
        """Take back that the whole is done, then its face for readers; the records of the parts stand alone again."""
        folder, done = Folder(self.path), Folder(self.path).record(DONE)
        for name, record in (done or {}).get("parts", {}).items():
            if name.isdigit():  # no other is that of a part
                folder.put(name, record)
        folder.drop(DONE)
        folder.remove("zarr.json")

    def invalidate(self, parts: Sequence[int]) -> None:
        """Take back the records of ``parts``; before them, that the whole is done, and its face for readers.

        Data and metadata of arrays stay; without ``zarr.json`` nobody opens by mistake what is not whole. Of an
        artifact that is one file nothing stays.
        """
        # as it is now: another may have taken it, or other parts, back since this thread looked
        with files.no_look(), files.glancing_at(self.path.parent):
            if parts and self.packed:
                files.remove(self.archive)
            for part in parts:
                self.unseal()
                Folder(self.path).drop(part_name(part))

    def siblings(self) -> list[Artifact]:
        """The artifacts of this stage and video with any settings, the one written last first."""
        marks = [(files.signature(mark), path) for mark, path in marks_in(self.path.parent)]
        dated = [(signature[0], path) for signature, path in marks if signature]
        return [Artifact(path) for _, path in sorted(dated, reverse=True)]

    def sibling(self) -> dict[str, Any] | None:
        """The description of the other one that was written last."""
        return next((a.description for a in self.siblings() if a.path != self.path and a.description), None)


def _taken_in(inside: Inside, name: str) -> dict[str, Any] | None:
    """The record of a part in the last record."""
    found: dict[str, Any] | None = (inside.record(DONE) or {}).get("parts", {}).get(name)
    return found


def part_name(part: int) -> str:
    """What the record of a part is called."""
    return f"{part:04d}"


def tables_name(part: int) -> str:
    """The file of the tables of a part."""
    return f"{RECORDS}/{part:04d}.tables"


def marks_in(stage: PurePath) -> Iterator[tuple[PurePath, PurePath]]:
    """The artifacts in the folder of a stage: the file that says when it was written, and its path."""
    for path in files.inside(stage):
        if files.is_link(path):
            continue
        if path.suffix == ARCHIVE:
            yield path, path.with_suffix("")
        elif path.suffix == "" and files.is_folder(path):
            yield path / RECORDS / f"{ABOUT}.json", path
