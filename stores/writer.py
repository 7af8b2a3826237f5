"""Writing one part of an artifact: the only code that writes arrays; the record comes last."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from zsmoseg.errors import SpaceError, StoreError
from zsmoseg.stores import archive, files, shards
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import ABOUT, AGAIN, Artifact, PartRecord, part_name, tables_name
from zsmoseg.stores.beginning import first_part
from zsmoseg.stores.fields import fields_of
from zsmoseg.stores.fixedpoint import encode
from zsmoseg.stores.inside import Folder, Growing, Memory
from zsmoseg.stores.packing import pack
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.stores.sealing import seal

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
        if part >= len(artifact.parts):
            raise StoreError(f"{artifact.path}: is gone or damaged; {AGAIN}")
        self._start, self._stop = artifact.parts[part]
        self._inside = artifact.held or Folder(artifact.path)
        self._specs = {name: ArraySpec.from_json(about) for name, about in artifact.arrays.items()}
        self._files: dict[str, dict[str, int]] = {}
        self._clipped: dict[str, int] = {}
        self._blocks: list[dict[str, Any]] = []
        self._tables: Growing | None = None
        self._missing = set(self._specs)
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
                offset = self._add(content)
            entry = [field.dtype, list(array.shape), offset, len(content), files.crc32(content)]
            tables[name] = entry
        if tables:
            self._blocks.append({"start": block.start, "stop": block.stop, "tables": tables})

    def _add(self, table: bytes) -> int:
        if self._tables is None:
            self._tables = self._inside.growing(tables_name(self.part))
        return self._tables.add(table)

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
        if name not in self._specs:
            raise ValueError(f"{name}: no video array of {self.artifact.path}")
        spec = self._specs[name]
        first, last = (min(edge, spec.shape[0]) for edge in (self._start, self._stop))
        expected = (last - first, *spec.shape[1:])
        if values.shape != expected:
            raise ValueError(f"{name}, part {self.part}: expected shape {expected}, got {values.shape}")
        try:
            stored, clipped = encode(values, spec.attributes, np.dtype(spec.dtype))
        except TypeError as error:
            raise TypeError(f"{name}: {error}") from error
        self._missing.discard(name)
        if clipped:
            self._clipped[name] = clipped
        if last == first:
            return
        shard = self.artifact.shard(name, self.part)
        content = shards.encode(stored, spec.chunk, first_part(self.artifact.laid_out), spec.kind)
        with self._disk():
            self._files[shard] = {}
            self._inside.write(shard, content)
            self._files[shard] = {"size": len(content), "crc32": files.crc32(content)}

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
            if self._tables is not None:
                self._tables.close()
                tables = {"size": self._tables.size, "crc32": self._tables.crc32}
                self._files[tables_name(self.part)] = tables
            facts = {**self.facts, "clipped": self._clipped} if self._clipped else self.facts
            content = {
                "start": self._start,
                "stop": self._stop,
                "files": self._files,
                "blocks": self._blocks,
                "facts": facts,
            }
            self._inside.put(part_name(self.part), content)
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
            self._close_tables()

    def _close_tables(self) -> None:
        if self._tables is not None:
            self._tables.close()

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Around writing: a full disk becomes a ``SpaceError``, and the part vanishes."""
        try:
            with files.errors_in_words(self.artifact.path):
                yield
        except SpaceError:
            self._close_tables()
            self._clear()
            raise

    def _clear(self) -> None:
        """Remove what the part had; leftovers of killed writers too."""
        if self.artifact.held is None:
            self.artifact.invalidate([self.part])
        for name in (tables_name(self.part), *(self.artifact.shard(name, self.part) for name in self._specs)):
            self._inside.remove(name)


def write_archive(
    artifact: Artifact,
    laid_out: Mapping[str, Any],
    left: Iterable[Arrays],
    kind: type[Arrays] | None,
    times: Sequence[float],
    names: Sequence[str],
    facts: Callable[[], Mapping[str, Any]],
) -> None:
    """Write an artifact of one part as one file, whole or not at all.

    Parameters
    ----------
    laid_out
        See ``beginning.plan_of``.
    left
        What its task leaves.
    kind, times, names
        See ``sealing.seal``.
    facts
        Called when all is left: small facts for the record.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    memory = Memory({ABOUT: dict(laid_out)})
    held = replace(artifact, held=memory)
    with PartWriter(held, 0) as writer:
        for block in left:
            writer.put(block)
        writer.facts = dict(facts())
    if kind is not None:
        seal(held, kind, times, names)
    files.write_whole(artifact.archive, archive.encode(artifact.archive, memory))
