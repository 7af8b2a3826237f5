"""Saying that an artifact is finished: its tables joined for readers, its coordinates, the last record.

The joined tables and the coordinates make the folder a Zarr group that any reader opens whole. They can be made
again from the parts at any time; the last record has their sizes and checksums.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from zsmoseg.errors import StoreError
from zsmoseg.stores import files, joining
from zsmoseg.stores.arrays import Arrays, join, labels_of
from zsmoseg.stores.artifact import AGAIN, DONE, Artifact, chunk_name, part_name
from zsmoseg.stores.beginning import array_metadata
from zsmoseg.stores.checks import joined_problem, part_problem
from zsmoseg.stores.fields import IDS_OF, TIMES, tables_of
from zsmoseg.stores.inside import Folder
from zsmoseg.stores.leases import lease
from zsmoseg.stores.packing import group_bytes, json_bytes, metadata, pack, pack_text, pieces
from zsmoseg.stores.reader import blocks

Array = np.ndarray[Any, Any]
LARGEST, LONGEST = 2**26, 2**30
"""Bytes of a table up to which it is joined, gathered in memory and row by row: over all objects of a long video the cost
of one another grows with the cube of its length. Stages read blocks and need none joined."""


def seal_once(artifact: Artifact, kind: type[Arrays], times: Sequence[float], names: Sequence[str]) -> None:
    """As ``seal``, by whoever comes first; nothing where it was sealed already."""
    if joined_problem(artifact):
        with lease(artifact.lease_path("seal")), files.glancing_at(artifact.path.parent):
            if joined_problem(artifact):
                seal(artifact, kind, times, names)


def seal(
    artifact: Artifact,
    kind: type[Arrays],
    times: Sequence[float],
    names: Sequence[str],
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Join the tables, write the coordinates, and say that all is there.

    Parameters
    ----------
    kind
        What the parts were written as.
    times, names
        Of every frame: seconds, and what the source calls it. A pair has those of its first frame.
    extra
        What else the last record shall hold.

    Raises
    ------
    StoreError
        If a part is not usable.
    SpaceError
        If the disk is full.
    """
    for part in range(len(artifact.parts)):
        if problem := part_problem(artifact, part):
            raise StoreError(f"{artifact.path}: part {part}: {problem}; {AGAIN}")
    if not artifact.parts:
        raise StoreError(f"{artifact.path}: artifact.json is missing or damaged; {AGAIN}")
    if artifact.held is None:
        artifact.unseal()
    whole = _Whole(artifact)
    frames = artifact.parts[-1][1]
    joined = join(kind, artifact, blocks(artifact, 0, frames), 0, frames)
    for name, declared in tables_of(kind).items():
        if not joined.having(name) or joined.size(name) > (LONGEST if joined.streams(name) else LARGEST):
            continue
        rows: Iterable[Array]
        if joined.streams(name):
            rows, shape = joined.rows(name), joined.shape(name)
        else:
            value = joined.whole(name)
            assert value is not None
            rows, shape = [value], value.shape
        whole.put(
            name, rows, shape, np.dtype(declared.dtype), declared.dims, declared.fill, declared.attributes
        )
    for dim, source in IDS_OF.items():
        if dim in whole.sizes and source in joined.ids:
            ids = joined.ids[source]
            whole.put(dim, [ids], ids.shape, ids.dtype, (dim,), 0, {})
    _coordinates(whole, labels_of(kind, artifact), times, names)
    whole.close()
    if artifact.held is not None:
        whole.inside.put(DONE, {**(extra or {}), "files": whole.files})
        return
    # one record in the place of one a part: first the new one, then those that it takes in
    parts = {part_name(i): artifact.part_record(i) for i in range(len(artifact.parts))}
    whole.inside.put(DONE, {**(extra or {}), "files": whole.files, "parts": parts}, sync=True)
    for name in parts:
        whole.inside.drop(name)


def _coordinates(
    whole: _Whole, labels: Mapping[str, Sequence[str]], times: Sequence[float], names: Sequence[str]
) -> None:
    """Numbers of frames, pairs, rows and columns; times and names; labels of dimensions."""
    sizes = dict(whole.sizes)
    for dim in ("frame", "pair", "y", "x"):
        if dim in sizes:
            number = np.arange(sizes[dim], dtype=np.int64)
            whole.put(dim, [number], number.shape, number.dtype, (dim,), 0, {})
    timed = next((dim for dim in TIMES if dim in sizes), None)
    if timed is not None:
        count = sizes[timed]
        time = np.asarray(times[:count], np.float64)
        whole.put("time", [time], time.shape, time.dtype, (timed,), np.nan, {"units": "s"})
        whole.put_text("name", list(names[:count]), timed)
    for dim in labels.keys() & sizes.keys():
        if sizes[dim] != len(labels[dim]):
            raise ValueError(f"{whole.artifact.path}: {len(labels[dim])} labels for {sizes[dim]} of {dim}")
    for dim, text in labels.items():
        if dim in sizes:
            whole.put_text(dim, list(text), dim)


@dataclass
class _Whole:
    """The Zarr arrays of an artifact beside its video arrays, as they are written."""

    artifact: Artifact
    arrays: dict[str, bytes] = field(default_factory=dict)
    files: dict[str, dict[str, int]] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.inside = self.artifact.held or Folder(self.artifact.path)
        self.arrays = array_metadata(self.artifact.laid_out)
        if self.artifact.held is not None:
            for name, text in self.arrays.items():
                self._write(f"{name}/zarr.json", text)
        for described in self.artifact.arrays.values():
            self.sizes |= dict(zip(described["dims"], described["shape"], strict=True))

    def put(
        self,
        name: str,
        rows: Iterable[Array],
        shape: Sequence[int],
        dtype: np.dtype[Any],
        dims: Sequence[str],
        fill: float,
        attributes: Mapping[str, Any],
    ) -> None:
        """An array, a run of rows at a time; its first dimension is counted on the way."""
        self.inside.remove(name)
        width = int(np.prod(shape[1:])) * dtype.itemsize
        length = max(1, joining.CHUNK // max(width, 1))
        count, at = 0, 0
        for at, piece in enumerate(pieces(rows, length) if dims else rows):
            padded = _padded(piece, min(length, len(piece)) if at == 0 else length, fill) if dims else piece
            count += len(piece) if dims else 1
            if piece.size:
                self._write(f"{name}/{chunk_name(at, len(dims))}", pack(padded))
        found = (count, *shape[1:]) if dims else ()
        chunk = (count if at == 0 else length, *shape[1:]) if dims else ()
        self._described(name, metadata(dtype, found, chunk, dims, fill, attributes))
        self.sizes |= dict(zip(dims, found, strict=True))

    def put_text(self, name: str, values: Sequence[str], dim: str) -> None:
        """A coordinate of text along ``dim``."""
        self.inside.remove(name)
        if values:
            self._write(f"{name}/{chunk_name(0, 1)}", pack_text(values))
        self._described(name, metadata(None, [len(values)], [len(values)], [dim], 0, {}))

    def close(self) -> None:
        """The group, which makes it all readable at once."""
        told = sorted({"time", "name"} & self.arrays.keys())
        self._write("zarr.json", group_bytes({"coordinates": " ".join(told)} if told else {}, self.arrays))

    def _described(self, name: str, described: Mapping[str, Any]) -> None:
        self.arrays[name] = json_bytes(described)
        self._write(f"{name}/zarr.json", self.arrays[name])

    def _write(self, name: str, content: bytes) -> None:
        with files.errors_in_words(self.artifact.path):
            self.inside.write(name, content)
        self.files[name] = {"size": len(content), "crc32": files.crc32(content)}


def _padded(values: Array, length: int, fill: float) -> Array:
    """A chunk of full length: Zarr's chunks are all of one shape."""
    if len(values) == length:
        return values
    return np.concatenate([values, np.full((length - len(values), *values.shape[1:]), fill, values.dtype)])
