"""One artifact: what one stage left of one video with one key.

    artifact.json      stage, version, settings, keys of inputs, how it is cut, how its arrays lie
    data.zarr/         video arrays, one shard a part; parts/0003/ the tables of part 3
    parts/0003.json    written when part 3 is whole: its files, their sizes and checksums
    done.json          written last, when all parts are there

Existence is the record, never the bytes: a shard that is missing or empty would read as fill value.
Looking at records imports the standard library only; numpy and Zarr come with the first array.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import checks, files
from zsmoseg.stores.checks import Damage
from zsmoseg.stores.records import as_json, checksum, recall_record, write_record
from zsmoseg.stores.schema import TABLES, ArraySpec, layout

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from zsmoseg.stores.writer import PartWriter

    Array = np.ndarray[Any, Any]

AGAIN = "run the same command again"


@dataclass(frozen=True)
class PartRecord:
    """What a finished part left.

    Attributes
    ----------
    start, stop
        Its frames.
    files
        ``size`` and ``crc32`` of each file, by path relative to the artifact.
    tables
        Path of the data (None where a table has no element) by group ("" is the part's own) and name.
    facts
        What the task noted.
    """

    start: int
    stop: int
    files: Mapping[str, Mapping[str, int]]
    tables: Mapping[str, Mapping[str, str | None]]
    facts: Mapping[str, Any]

    @property
    def seconds(self) -> float:
        """How long the task took."""
        return float(self.facts.get("seconds", 0.0))

    @property
    def memory_mb(self) -> float:
        """Its peak memory."""
        return float(self.facts.get("memory_mb", 0.0))


@dataclass(frozen=True)
class Artifact:
    """The artifact in the folder ``path`` = ``STORE/VIDEO/STAGE/KEY``; it need not exist yet."""

    path: Path

    # ------------------------------------------------------------------ records
    @property
    def data(self) -> Path:
        """The Zarr group."""
        return self.path / "data.zarr"

    @property
    def laid_out(self) -> dict[str, Any]:
        """All of ``artifact.json``, empty where there is nothing or it is damaged; not to be changed."""
        return recall_record(self.path / "artifact.json") or {}

    @property
    def description(self) -> dict[str, Any] | None:
        """What ``begin`` was told, and ``parts``; None where there is nothing, or it is damaged."""
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
        return recall_record(self.path / "done.json")

    def record_path(self, part: int) -> Path:
        """The record of a part."""
        return self.path / "parts" / f"{part:04d}.json"

    def table_folder(self, part: int) -> Path:
        """The Zarr group of the tables of a part."""
        return self.data / TABLES / f"{part:04d}"

    def shard(self, name: str, part: int) -> Path:
        """The file that holds a part of a video array."""
        dimensions = len(self.laid_out["arrays"][name]["dims"])
        return self.data.joinpath(name, "c", str(part), *["0"] * (dimensions - 1))

    def part(self, part: int) -> PartRecord | None:
        """The record of a part; None where it is missing or damaged."""
        found = recall_record(self.record_path(part))
        fields = {"start", "stop", "files", "tables", "facts"}
        return PartRecord(**found) if found and found.keys() == fields else None

    # ------------------------------------------------------------------ laying out, sealing
    def begin(
        self,
        description: Mapping[str, Any],
        parts: Sequence[tuple[int, int]],
        video_arrays: Sequence[ArraySpec] = (),
    ) -> None:
        """Lay the artifact out, or mend its metadata; data and records stay. For one planner at a time.

        An artifact that exists keeps the parts and codecs it was begun with; one whose arrays are of another
        kind is begun anew.

        Parameters
        ----------
        description
            Stage, version, settings, keys of inputs and what else is worth knowing; JSON types.
        parts
            The frames of each part, in order, without gaps. With video arrays all but the last are equally
            long.

        Raises
        ------
        ValueError
            If the parts are not such.
        SpaceError
            If the disk is full.
        """
        _check_cut(parts, video_arrays)
        arrays = {spec.name: spec.to_json() for spec in video_arrays}
        content = as_json({**description, "parts": parts, "arrays": arrays})
        old = self.laid_out
        if old and old["arrays"] == content["arrays"] and old["parts"][-1][1] == content["parts"][-1][1]:
            content |= {"parts": old["parts"], "layout": old["layout"]}
        else:
            if old or self._cut_otherwise(parts):
                for name in ("done.json", "parts", "data.zarr"):
                    files.remove(self.path / name)
            content["layout"] = layout(video_arrays, parts[0][1] - parts[0][0])
        if content != old:
            write_record(self.path / "artifact.json", content)
        os.utime(self.path / "artifact.json")
        for path, text in self.metadata():
            if files.read(path) != text:
                files.write_whole(path, text)
        if self.done is None:
            for leftover in files.leftovers(self.path):
                files.remove(leftover)

    def _cut_otherwise(self, parts: Sequence[tuple[int, int]]) -> bool:
        """Whether records are left from a time when the artifact was cut in another way."""
        known = [int(path.stem) for path in (self.path / "parts").glob("[0-9]*.json")]
        records = [(i, record) for i in known if (record := self.part(i))]
        return any(i >= len(parts) or (record.start, record.stop) != tuple(parts[i]) for i, record in records)

    def metadata(self) -> Iterator[tuple[Path, bytes]]:
        """The metadata files of the Zarr group that no part owns, and what they have to hold."""
        for name, content in self.laid_out.get("layout", {}).items():
            yield self.data / name, json.dumps(content, indent=2).encode()

    def invalidate(self, parts: Iterable[int]) -> None:
        """Take back the records of ``parts``; before them, that the whole is done. Data and metadata stay."""
        for part in parts:
            files.remove(self.path / "done.json")
            files.remove(self.record_path(part))

    def seal(self, extra: Mapping[str, Any] | None = None) -> None:
        """Say that all is there.

        Parameters
        ----------
        extra
            What else ``done`` shall hold.

        Raises
        ------
        StoreError
            If a part is not usable.
        """
        for part in range(len(self.parts)):
            if problem := self.part_problem(part):
                raise StoreError(f"{self.path}: part {part}: {problem}; {AGAIN}")
        if not self.parts:
            raise StoreError(f"{self.path}: artifact.json is missing or damaged; {AGAIN}")
        records = [recall_record(self.record_path(part)) for part in range(len(self.parts))]
        content = {**(extra or {}), "records": [checksum(record) for record in records if record]}
        write_record(self.path / "done.json", content, sync=True)

    # ------------------------------------------------------------------ whether all is well
    def part_problem(self, part: int) -> str | None:
        """Why a part is not usable, by its record and the sizes of its files; None where it is."""
        return checks.part_problem(self, part)

    def check(self, deep: bool = False) -> list[Damage]:
        """What is damaged: by sizes, or by content too (``deep``). Parts not computed yet are no damage."""
        return checks.check(self, deep)

    # ------------------------------------------------------------------ writing
    def writer(self, part: int) -> PartWriter:
        """Write a part bit by bit, in a ``with`` block; its record appears at the end.

        Raises
        ------
        SpaceError
            If the disk is full; what was written of the part is removed.
        """
        from zsmoseg.stores.writer import PartWriter

        return PartWriter(self, part)

    def write(
        self,
        part: int,
        arrays: Mapping[str, Array] | None = None,
        tables: Mapping[str, Array] | None = None,
        attributes: Mapping[str, Any] | None = None,
        *,
        seconds: float | None = None,
        memory_mb: float | None = None,
    ) -> PartRecord:
        """Write a part at once, over what it had before.

        Parameters
        ----------
        arrays
            Every video array by name: (rows of this part, ...), physical values.
        tables
            By name, any size; booleans, integers or floating numbers.
        attributes, seconds, memory_mb
            For the record's facts.

        Raises
        ------
        TypeError, ValueError
            If types or shapes are not as laid out.
        SpaceError
            If the disk is full; what was written of the part is removed.
        """
        writer = self.writer(part)
        writer.put_arrays(arrays or {})
        writer.put_tables(tables or {})
        measured = {"seconds": seconds, "memory_mb": memory_mb}
        writer.facts = {**(attributes or {}), **{k: v for k, v in measured.items() if v is not None}}
        return writer.close()

    # ------------------------------------------------------------------ reading
    def zarr_array(self, name: str) -> Any:
        """The Zarr array ``name``, opened once a process."""
        from zsmoseg.stores.reader import open_array

        return open_array(self, name)

    def has(self, name: str) -> bool:
        """Whether there is a video array ``name``."""
        return name in self.arrays

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a video array."""
        return tuple(self.laid_out["arrays"][name]["shape"])

    def read(self, name: str, start: int, stop: int, raw: bool = False) -> Array:
        """Frames (or pairs) ``start`` to ``stop - 1`` of a video array.

        Parameters
        ----------
        raw
            As stored. Else arrays with a scale come in physical units, float32, NaN where unknown.

        Raises
        ------
        StoreError
            If a file that holds them is missing or not as its record says.
        ValueError
            If the array is not that long.
        """
        from zsmoseg.stores.reader import read

        return read(self, name, start, stop, raw)

    def read_table(self, part: int, group: str | None = None) -> dict[str, Array]:
        """The tables of a part, of its own group or of a named one.

        Raises
        ------
        StoreError
            If a file is missing or not as its record says, or there is no such group.
        """
        from zsmoseg.stores.reader import read_tables

        return {name: values for name, (values, _) in read_tables(self, part, group or "").items()}

    def groups(self, part: int) -> list[str]:
        """The named groups of tables of a part."""
        record = self.part(part)
        return sorted(group for group in record.tables if group) if record else []

    def dataset(self, times: Sequence[float], names: Sequence[str]) -> xr.Dataset:
        """All of it for users: lazily, labelled, in physical units. See ``zsmoseg.stores.dataset``."""
        from zsmoseg.stores.dataset import open_dataset

        return open_dataset(self, times, names)

    # ------------------------------------------------------------------ neighbours
    def siblings(self) -> list[Artifact]:
        """The artifacts of this stage and video with any settings, the one used last first."""
        folders = files.folders(self.path.parent)
        marks = [(files.signature(folder / "artifact.json"), folder) for folder in folders]
        dated = [(signature[0], folder) for signature, folder in marks if signature]
        return [Artifact(folder) for _, folder in sorted(dated, reverse=True)]

    def sibling(self) -> dict[str, Any] | None:
        """The description of the other one that was used last."""
        return next((a.description for a in self.siblings() if a.path != self.path and a.description), None)


def _check_cut(parts: Sequence[tuple[int, int]], video_arrays: Sequence[ArraySpec]) -> None:
    if not parts or parts[0][0] != 0 or any(a[1] != b[0] for a, b in pairwise(parts)):
        raise ValueError(f"parts {list(parts)} do not follow each other from frame 0 on")
    length, last = parts[0][1], parts[-1]
    regular = all(stop - start == length for start, stop in parts[:-1]) and 0 < last[1] - last[0] <= length
    if video_arrays and not regular:
        raise ValueError(f"parts {list(parts)} are not equally long: a part is a shard of every array")
    for spec in video_arrays:
        if spec.shape[0] != last[1] - (spec.dims[0] == "pair"):
            raise ValueError(f"{spec.name}: {spec.shape[0]} rows do not fit {last[1]} frames")
