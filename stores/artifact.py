"""One artifact: what one stage left of one video with one key.

    artifact.json      stage, version, settings, keys of inputs, how it is cut
    data.zarr/         video arrays, whole shards; parts/0003/ the tables of one part
    parts/0003.json    written when part 3 is whole: its files, their sizes and checksums
    done.json          written last, when all parts are there

Existence is the record, never the bytes: a shard that is missing or empty would read as fill value.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zsmoseg.errors import SpaceError, StoreError
from zsmoseg.stores.records import read_json, write_json
from zsmoseg.stores.schema import ArraySpec, decode, encode, image_codecs, table_codecs

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class PartRecord:
    """What a finished part left: files with ``size`` and ``crc32c``, and small facts."""

    files: Mapping[str, Mapping[str, Any]]
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class Damage:
    """A file that is not as its record says."""

    path: Path
    what: str


@dataclass
class Writer:
    """Writes one part; its record appears when the ``with`` block of ``Artifact.writer`` ends well."""

    artifact: Artifact
    part: int
    facts: dict[str, Any] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)

    def put_arrays(self, arrays: Mapping[str, Array]) -> None:
        """This part's frames (or pairs) of video arrays, physical values."""
        start = self.artifact.parts[self.part][0]
        for name, values in arrays.items():
            array = self.artifact.zarr_array(name)
            if array.shape[1:] != values.shape[1:]:
                raise StoreError(f"{self.artifact.path}: {name}: expected {array.shape[1:]} a frame, got {values.shape[1:]}")
            if not len(values):
                continue
            zeros = "/".join(["0"] * (array.ndim - 1))
            shard = self.artifact.data / name / "c" / str(start // array.shards[0]) / zeros
            shard.unlink(missing_ok=True)  # a damaged one would be read, to be completed
            stored = encode(values, array.attrs, array.dtype)
            array.with_config({"write_empty_chunks": True})[start : start + len(values)] = stored
            self.files.append(shard)

    def put_tables(self, tables: Mapping[str, Array], group: str = "") -> None:
        """Tables of this part alone, of any size and kind."""
        if not tables:
            return
        import zarr

        folder = self.artifact.table_folder(self.part) / group
        target = zarr.open_group(folder, mode="a")
        self.files.append(folder / "zarr.json")
        for name, values in tables.items():
            target.create_array(
                name,
                data=values,
                chunks=tuple(max(n, 1) for n in values.shape),
                compressors=table_codecs(),
                dimension_names=[f"{name}_{i}" for i in range(values.ndim)],
                config={"write_empty_chunks": True},
            )
            self.files.append(folder / name / "zarr.json")
            if values.size:
                self.files.append(folder / name / "c" / "/".join(["0"] * values.ndim))


@dataclass(frozen=True)
class Artifact:
    """The artifact in the folder ``path`` = ``STORE/VIDEO/STAGE/KEY``; it need not exist yet."""

    path: Path

    @property
    def data(self) -> Path:
        """The Zarr group."""
        return self.path / "data.zarr"

    @property
    def description(self) -> dict[str, Any] | None:
        """What ``begin`` was told; None where there is nothing, or it is damaged."""
        return read_json(self.path / "artifact.json")

    @property
    def parts(self) -> list[tuple[int, int]]:
        """The frames (start, stop) of each part."""
        described = self.description
        return [(a, b) for a, b in described["parts"]] if described else []

    @property
    def done(self) -> dict[str, Any] | None:
        """The last record; None until all is there."""
        return read_json(self.path / "done.json")

    def table_folder(self, part: int) -> Path:
        """The Zarr group of the tables of a part."""
        return self.data / "parts" / f"{part:04d}"

    # ------------------------------------------------------------------ laying out, sealing
    def begin(
        self, description: Mapping[str, Any], parts: Sequence[tuple[int, int]], specs: Sequence[ArraySpec]
    ) -> None:
        """Lay the artifact out, or mend its metadata; data and records stay."""
        self.data.mkdir(parents=True, exist_ok=True)
        content = {**description, "parts": [list(p) for p in parts]}
        if self.description != content:
            write_json(self.path / "artifact.json", content)
        os.utime(self.path / "artifact.json")
        for name, text in _metadata(tuple(specs), parts[0][1] - parts[0][0]).items():
            path = self.data / name
            if not path.exists() or path.read_bytes() != text:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(text)

    def invalidate(self, parts: Iterable[int]) -> None:
        """Take back the records of ``parts``, and that the whole is done."""
        for part in parts:
            (self.path / "done.json").unlink(missing_ok=True)
            (self._record(part)).unlink(missing_ok=True)

    def seal(self) -> None:
        """Say that all is there.

        Raises
        ------
        StoreError
            If it is not.
        """
        records = {}
        for part in range(len(self.parts)):
            if problem := self.part_problem(part):
                raise StoreError(f"{self.path}: part {part}: {problem}; run the same command again")
            records[f"{part:04d}"] = self._record(part).stat().st_size
        write_json(self.path / "done.json", {"records": records}, sync=True)

    # ------------------------------------------------------------------ parts
    def _record(self, part: int) -> Path:
        return self.path / "parts" / f"{part:04d}.json"

    def part(self, part: int) -> PartRecord | None:
        """The record of a part; None where it is missing or damaged."""
        content = read_json(self._record(part))
        return PartRecord(content["files"], content["facts"]) if content else None

    def part_problem(self, part: int) -> str | None:
        """Why a part is not usable, by records and sizes; None where it is."""
        record = self.part(part)
        if record is None:
            return "not computed yet" if not self._record(part).exists() else "its record is damaged"
        return next((f"{d.path.name} {d.what}" for d in self._wrong_sizes(record)), None)

    def _wrong_sizes(self, record: PartRecord) -> Iterator[Damage]:
        for name, entry in record.files.items():
            try:
                size = (self.path / name).stat().st_size
            except OSError:
                yield Damage(self.path / name, "is missing")
                continue
            if size != entry["size"]:
                yield Damage(self.path / name, f"has {size} bytes instead of {entry['size']}")

    def check(self) -> Iterator[Damage]:
        """Compare every file with its record, content too."""
        if self.description is None:
            yield Damage(self.path / "artifact.json", "is missing or damaged")
        for part in range(len(self.parts)):
            record = self.part(part)
            if record is None:
                if self.done is not None:
                    yield Damage(self._record(part), "is missing or damaged")
                continue
            wrong = list(self._wrong_sizes(record))
            yield from wrong
            for name, entry in record.files.items():
                if self.path / name not in [d.path for d in wrong] and _crc32c(self.path / name) != entry["crc32c"]:
                    yield Damage(self.path / name, "has other content than was written")

    @contextmanager
    def writer(self, part: int) -> Iterator[Writer]:
        """Write a part; its record appears last.

        Raises
        ------
        SpaceError
            If the disk is full; what was written of the part is removed.
        """
        shutil.rmtree(self.table_folder(part), ignore_errors=True)
        writer = Writer(self, part)
        try:
            yield writer
            files = {
                str(path.relative_to(self.path)): {"size": path.stat().st_size, "crc32c": _crc32c(path)}
                for path in writer.files
            }
            write_json(self._record(part), {"files": files, "facts": writer.facts})
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            for path in writer.files:
                path.unlink(missing_ok=True)
            raise SpaceError(
                f"{self.path}: no space left on the disk; free some and run the same command again"
            ) from error

    # ------------------------------------------------------------------ reading
    def zarr_array(self, name: str) -> Any:
        """The Zarr array ``name``, opened once a process."""
        return _open_array(str(self.data / name))

    def has(self, name: str) -> bool:
        """Whether there is a video array ``name``."""
        return (self.data / name / "zarr.json").exists()

    def shape(self, name: str) -> tuple[int, ...]:
        """Shape of a video array."""
        return tuple(self.zarr_array(name).shape)

    def read(self, name: str, start: int, stop: int) -> Array:
        """Frames (or pairs) ``start`` to ``stop - 1`` of a video array, in physical units.

        Raises
        ------
        StoreError
            If a part that holds them is not whole.
        """
        for part, (a, b) in enumerate(self.parts):
            if a < stop and b > start and (problem := self.part_problem(part)):
                raise StoreError(f"{self.path}: frames {a} to {b - 1}: {problem}; run the same command again")
        array = self.zarr_array(name)
        return decode(array[start:stop], array.attrs)

    def read_table(self, part: int, group: str = "") -> dict[str, Array]:
        """The tables of a part.

        Raises
        ------
        StoreError
            If the part is not whole.
        """
        import zarr

        if problem := self.part_problem(part):
            raise StoreError(f"{self.path}: part {part}: {problem}; run the same command again")
        found = zarr.open_group(self.table_folder(part) / group, mode="r")
        return {name: np.asarray(array[...]) for name, array in sorted(found.arrays())}

    def groups(self, part: int) -> list[str]:
        """The named groups of tables of a part."""
        folder = self.table_folder(part)
        return sorted(p.name for p in folder.iterdir() if (p / "zarr.json").exists() and not (p / "c").exists() and _is_group(p))

    def dataset(self, times: Sequence[float], names: Sequence[str]) -> xr.Dataset:
        """The video arrays, labelled, lazily, in physical units."""
        import xarray as xr

        found = xr.open_zarr(self.data, consolidated=False, chunks=None)
        for dim in {"frame", "pair"} & set(found.dims):
            count = found.sizes[dim]
            found = found.assign_coords(
                {
                    dim: np.arange(count),
                    "time": (dim, np.asarray(times[:count]), {"units": "s"}),
                    "name": (dim, np.asarray(names[:count], dtype=object)),
                }
            )
        return found

    # ------------------------------------------------------------------ neighbours
    def siblings(self) -> list[Artifact]:
        """The artifacts of this stage and video with any settings, the one used last first."""
        if not self.path.parent.is_dir():
            return []
        marks = [p / "artifact.json" for p in self.path.parent.iterdir()]
        dated = [(m.stat().st_mtime_ns, m.parent) for m in marks if m.exists()]
        return [Artifact(folder) for _, folder in sorted(dated, reverse=True)]

    def sibling(self) -> dict[str, Any] | None:
        """The description of the other one that was used last."""
        return next((a.description for a in self.siblings() if a.path != self.path and a.description), None)


def _is_group(folder: Path) -> bool:
    return (read_json(folder / "zarr.json") or {}).get("node_type") == "group"


@lru_cache(maxsize=256)
def _open_array(path: str) -> Any:
    import zarr

    return zarr.open_array(path, mode="r+")


@lru_cache(maxsize=64)
def _metadata(specs: tuple[ArraySpec, ...], length: int) -> dict[str, bytes]:
    """The zarr.json of the group, of its ``parts`` and of every array, by relative path."""
    import zarr
    from zarr.storage import MemoryStore

    memory = MemoryStore()
    root = zarr.create_group(memory)
    root.create_group("parts")
    for spec in specs:
        root.create_array(
            spec.name,
            shape=spec.shape,
            chunks=spec.chunk(),
            shards=(length, *spec.shape[1:]),
            dtype=spec.dtype,
            fill_value=spec.fill,
            compressors=image_codecs(spec.kind),
            dimension_names=spec.dims,
            attributes=spec.attributes,
        )
    return {name: bytes(value.to_bytes()) for name, value in memory._store_dict.items()}


def _crc32c(path: Path) -> int:
    import google_crc32c

    return int(google_crc32c.value(path.read_bytes()))
