"""Writing one part of an artifact: the only code that writes arrays; the record comes last."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from zsmoseg.errors import SpaceError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact, PartRecord
from zsmoseg.stores.fixedpoint import encode
from zsmoseg.stores.records import write_record
from zsmoseg.stores.tables import GROUP, chunk_name, pack

Array = np.ndarray[Any, Any]


class PartWriter:
    """Writes part ``part``; ``close``, or the end of a ``with`` block without an error, writes its record.

    What the part had before is taken back first, its record before all, so that a crash leaves nothing that
    looks finished. A disk that is full takes away all that was written of the part.

    Attributes
    ----------
    facts
        Small facts for the record, JSON types or numpy's.
    """

    def __init__(self, artifact: Artifact, part: int) -> None:
        self.artifact = artifact
        self.part = part
        self.facts: dict[str, Any] = {}
        self._start, self._stop = artifact.parts[part]
        self._files: dict[Path, dict[str, int]] = {}
        self._clipped: dict[str, int] = {}
        self._tables: dict[str, dict[str, str | None]] = {}
        self._missing = set(artifact.arrays)
        self._clear()

    def put_arrays(self, arrays: Mapping[str, Array]) -> None:
        """Write the part's frames (or pairs) of video arrays, all at once.

        Parameters
        ----------
        arrays
            By name: (rows of this part, ...), physical values: floating where the array has a scale, else of
            its own type.

        Raises
        ------
        TypeError, ValueError
            If type or shape are not those of the array.
        SpaceError
            If the disk is full.
        """
        for name, values in arrays.items():
            if name not in self.artifact.arrays:
                raise ValueError(f"{name}: no video array of {self.artifact.path}")
            array = self.artifact.zarr_array(name)
            first, last = (min(edge, array.shape[0]) for edge in (self._start, self._stop))
            expected = (last - first, *array.shape[1:])
            if values.shape != expected:
                raise ValueError(f"{name}, part {self.part}: expected shape {expected}, got {values.shape}")
            try:
                stored, clipped = encode(values, array.attrs, array.dtype)
            except TypeError as error:
                raise TypeError(f"{name}: {error}") from error
            self._missing.discard(name)
            if clipped:
                self._clipped[name] = clipped
            if last == first:
                continue
            shard = self.artifact.shard(name, self.part)
            with self._disk():
                self._files[shard] = {}
                array[first:last] = stored
                content = shard.read_bytes()
            self._files[shard] = _entry(content)

    def put(
        self, group: str, tables: Mapping[str, Array], dims: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """Tables of this part alone, of any length; ``group`` "" is the part's own group.

        Parameters
        ----------
        tables
            Booleans, integers or floating numbers, by name.
        dims
            Names of the dimensions, by table; without them a table has dimensions of its own.

        Raises
        ------
        TypeError
            If a table is of another kind.
        SpaceError
            If the disk is full.
        """
        if "/" in group or group.startswith("."):
            raise ValueError(f"{group}: no name for a group of tables")
        folder = self.artifact.table_folder(self.part)
        for place in {folder, folder / group}:
            self._write(place / "zarr.json", GROUP)
        self._tables.setdefault(group, {})
        for name, values in tables.items():
            array = np.asarray(values)
            named = (dims or {}).get(name) or [f"{name}_{i}" for i in range(array.ndim)]
            metadata, chunk = pack(array, named)
            self._put_table(group, name, array.ndim, metadata, chunk)

    def put_tables(
        self, tables: Mapping[str, Array], group: str = "", dims: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        """As ``put``, nothing where there are no tables."""
        if tables:
            self.put(group, tables, dims)

    def close(self) -> PartRecord:
        """Write the record.

        Raises
        ------
        ValueError
            If a video array was left out.
        SpaceError
            If the disk is full.
        """
        if self._missing:
            lacking = ", ".join(sorted(self._missing))
            raise ValueError(f"{self.artifact.path}: part {self.part} lacks {lacking}")
        facts = {**self.facts, "clipped": self._clipped} if self._clipped else self.facts
        content = {
            "start": self._start,
            "stop": self._stop,
            "files": {self._relative(path): entry for path, entry in self._files.items()},
            "tables": self._tables,
            "facts": facts,
        }
        with self._disk():
            write_record(self.artifact.record_path(self.part), content)
        record = self.artifact.part(self.part)
        assert record is not None
        return record

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()

    # ------------------------------------------------------------------ files
    def _put_table(self, group: str, name: str, ndim: int, metadata: bytes, chunk: bytes | None) -> None:
        twice = name in self._tables if not group else group in self._tables.get("", ())
        if twice or not name.isidentifier():
            raise ValueError(f"{group}/{name}: no name for a table, or that of a group")
        place = self.artifact.table_folder(self.part) / group / name
        self._write(place / "zarr.json", metadata)
        content = place / chunk_name(ndim)
        if chunk is not None:
            self._write(content, chunk)
        self._tables.setdefault(group, {})[name] = None if chunk is None else self._relative(content)

    def _relative(self, path: Path) -> str:
        return path.relative_to(self.artifact.path).as_posix()

    def _write(self, path: Path, content: bytes) -> None:
        with self._disk():
            files.write(path, content)
        self._files[path] = _entry(content)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Around writing: a full disk becomes a ``SpaceError``, and the part vanishes."""
        try:
            with files.full_disk_in_words(self.artifact.path):
                yield
        except SpaceError:
            self._clear()
            raise

    def _clear(self) -> None:
        """Remove what the part had; leftovers of killed writers too."""
        self.artifact.invalidate([self.part])
        files.remove(self.artifact.table_folder(self.part))
        for name in self.artifact.arrays:
            files.remove(self.artifact.data / name / "c" / str(self.part))


def _entry(content: bytes) -> dict[str, int]:
    return {"size": len(content), "crc32": files.crc32(content)}
