"""Writing one part of an artifact: the only code that writes arrays; the record comes last."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import TracebackType
from typing import Any, Self

import numpy as np

from zsmoseg.errors import SpaceError
from zsmoseg.stores import files
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import Artifact, PartRecord
from zsmoseg.stores.fields import fields_of
from zsmoseg.stores.fixedpoint import encode
from zsmoseg.stores.packing import pack
from zsmoseg.stores.reader import open_array
from zsmoseg.stores.records import write_record

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
        self._files: dict[PurePath, dict[str, int]] = {}
        self._clipped: dict[str, int] = {}
        self._blocks: list[dict[str, Any]] = []
        self._tables = files.Appended(artifact.tables_path(part))
        self._missing = set(artifact.arrays)
        self._clear()

    def put(self, block: Arrays) -> None:
        """Write what ``block`` holds: video arrays of all frames (or pairs) of the part, and tables of some.

        Raises
        ------
        TypeError, ValueError
            If type or shape are not those that its class declares.
        SpaceError
            If the disk is full.
        """
        if not self._start <= block.start <= block.stop <= self._stop:
            raise ValueError(f"frames {block.start} to {block.stop - 1} are not in part {self.part}")
        tables: dict[str, list[Any]] = {}
        lengths: dict[str, int] = {}
        for name, field in fields_of(type(block)).items():
            values = getattr(block, name)
            if values is None:
                continue
            if field.grid is not None:
                self._put_video(name, values)
                continue
            array = np.asarray(values)
            if array.dtype != field.dtype or array.ndim != len(field.dims):
                raise TypeError(
                    f"{name}: expected {field.dtype} {field.dims}, got {array.dtype} of shape {array.shape}"
                )
            self._check_lengths(block, name, dict(zip(field.dims, array.shape, strict=True)), lengths)
            content = pack(array)
            with self._disk():
                offset = self._tables.add(content)
            entry = [field.dtype, list(array.shape), offset, len(content), files.crc32(content)]
            tables[name] = entry
        if tables:
            self._blocks.append({"start": block.start, "stop": block.stop, "tables": tables})

    def _check_lengths(
        self, block: Arrays, name: str, sizes: dict[str, int], lengths: dict[str, int]
    ) -> None:
        """Raise ``ValueError`` where a dimension has not the length that frames, or another table, give it."""
        frames, parts = block.stop - block.start, self.artifact.parts
        pairs = min(block.stop, parts[-1][1] - 1) - block.start
        # a block of a shot lacks the pair over the cut behind it; one of a chunk lacks none
        shot = (frames - 1,) if len(parts) == 1 else ()
        allowed = {"frame": (frames,), "pair": (*shot, pairs)}
        for dim, size in sizes.items():
            known = allowed.get(dim, (lengths.setdefault(dim, size),))
            if size not in known:
                raise ValueError(f"{name}, part {self.part}: expected {known[-1]} along {dim}, got {size}")

    def _put_video(self, name: str, values: Array) -> None:
        if name not in self.artifact.arrays:
            raise ValueError(f"{name}: no video array of {self.artifact.path}")
        array = open_array(self.artifact, name)
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
            return
        shard = self.artifact.shard(name, self.part)
        with self._disk():
            self._files[shard] = {}
            array[first:last] = stored
            self._files[shard] = files.entry(shard)

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
        with self._disk():
            if self._blocks:
                self._tables.close()
                self._files[self._tables.path] = {"size": self._tables.size, "crc32": self._tables.crc32}
            facts = {**self.facts, "clipped": self._clipped} if self._clipped else self.facts
            content = {
                "start": self._start,
                "stop": self._stop,
                "files": {
                    path.relative_to(self.artifact.path).as_posix(): e for path, e in self._files.items()
                },
                "blocks": self._blocks,
                "facts": facts,
            }
            write_record(self.artifact.record_path(self.part), content)
        record = self.artifact.part(self.part)
        assert record is not None
        return record

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self.close()
        finally:
            self._tables.close()

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Around writing: a full disk becomes a ``SpaceError``, and the part vanishes."""
        try:
            with files.errors_in_words(self.artifact.path):
                yield
        except SpaceError:
            self._tables.close()
            self._clear()
            raise

    def _clear(self) -> None:
        """Remove what the part had; leftovers of killed writers too."""
        self.artifact.invalidate([self.part])
        files.remove(self._tables.path)
        for name in self.artifact.arrays:
            files.remove(files.below(self.artifact.path, f"{name}/c/{self.part}"))
