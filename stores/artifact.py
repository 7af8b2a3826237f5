"""One artifact: what one stage left of one video with one key. Its folder is a Zarr v3 group that xarray opens.

    zarr.json               written when all is there: the metadata of all arrays in one file
    forward/, valid/, ...   the arrays: of video arrays one shard a part; tables joined when all parts are there
    records/artifact.json   stage, version, settings, keys of inputs, how it is cut, how its video arrays lie
    records/0003.tables     what part 3 found out, as it was written; stages read this
    records/0003.json       written when part 3 is whole: its files, their sizes and checksums
    records/done.json       written last: all parts are there, and the joined tables

Existence is the record, never the bytes: a shard that is missing or empty would read as fill value. Looking at
records imports the standard library only.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.records import RECORDS, recall_record

AGAIN = "run the same command again"


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


@dataclass(frozen=True)
class Artifact:
    """The artifact in the folder ``path`` = ``STORE/VIDEO/STAGE/KEY``; it need not exist yet."""

    path: PurePath

    @property
    def records(self) -> PurePath:
        """The folder of what is not Zarr."""
        return files.below(self.path, RECORDS)

    @property
    def laid_out(self) -> dict[str, Any]:
        """All of ``artifact.json``, empty where there is nothing or it is damaged; not to be changed."""
        return recall_record(self.records / "artifact.json") or {}

    @property
    def description(self) -> dict[str, Any] | None:
        """What it was begun with, and ``parts``; None where there is nothing, or it is damaged."""
        told = {name: value for name, value in self.laid_out.items() if name not in ("arrays", "layout")}
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
        return recall_record(self.records / "done.json")

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a video array."""
        return tuple(self.laid_out["arrays"][name]["shape"])

    # ------------------------------------------------------------------ parts
    def record_path(self, part: int) -> PurePath:
        """The record of a part."""
        return self.records / f"{part:04d}.json"

    def tables_path(self, part: int) -> PurePath:
        """The file of the tables of a part."""
        return self.records / f"{part:04d}.tables"

    def lease_path(self, part: int) -> PurePath:
        """Who works on a part."""
        return self.records / f"{part:04d}.lease"

    def shard(self, name: str, part: int) -> PurePath:
        """The file that holds a part of a video array."""
        dimensions = len(self.laid_out["arrays"][name]["dims"])
        return files.below(self.path, "/".join([name, "c", str(part), *["0"] * (dimensions - 1)]))

    def part(self, part: int) -> PartRecord | None:
        """The record of a part; None where it is missing or damaged."""
        found = recall_record(self.record_path(part))
        fields = {"start", "stop", "files", "blocks", "facts"}
        return PartRecord(**found) if found and found.keys() == fields else None

    def blocks(self, part: int) -> Iterator[Block]:
        """The blocks of a finished part, in order; none where its record is missing."""
        record = self.part(part)
        for block in record.blocks if record else ():
            tables = {name: TableEntry(*entry) for name, entry in block["tables"].items()}
            yield Block(part, block["start"], block["stop"], tables)

    # ------------------------------------------------------------------ metadata, neighbours
    def metadata(self) -> Iterator[tuple[PurePath, bytes]]:
        """The metadata files of the video arrays, and what they have to hold."""
        for name, content in self.laid_out.get("layout", {}).items():
            yield files.below(self.path, f"{name}/zarr.json"), json.dumps(content, indent=2).encode()

    def unseal(self) -> None:
        """Take back that the whole is done, then its face for readers."""
        files.remove(self.records / "done.json")
        files.remove(self.path / "zarr.json")

    def invalidate(self, parts: Sequence[int]) -> None:
        """Take back the records of ``parts``; before them, that the whole is done, and its face for readers.

        Data and metadata of arrays stay; without ``zarr.json`` nobody opens by mistake what is not whole.
        """
        for part in parts:
            self.unseal()
            files.remove(self.record_path(part))

    def siblings(self) -> list[Artifact]:
        """The artifacts of this stage and video with any settings, the one used last first."""
        folders = files.folders(self.path.parent)
        marks = [(files.signature(folder / RECORDS / "artifact.json"), folder) for folder in folders]
        dated = [(signature[0], folder) for signature, folder in marks if signature]
        return [Artifact(folder) for _, folder in sorted(dated, reverse=True)]

    def sibling(self) -> dict[str, Any] | None:
        """The description of the other one that was used last."""
        return next((a.description for a in self.siblings() if a.path != self.path and a.description), None)
