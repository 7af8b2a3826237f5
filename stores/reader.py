"""Reading arrays of an artifact: only what a record vouches for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from zsmoseg.errors import StoreError
from zsmoseg.stores import files, shards
from zsmoseg.stores.artifact import AGAIN, Artifact, Block, PartRecord, tables_name
from zsmoseg.stores.beginning import first_part
from zsmoseg.stores.checks import part_problem, wrong_content, wrong_sizes
from zsmoseg.stores.fixedpoint import decode
from zsmoseg.stores.packing import unpack
from zsmoseg.stores.schema import ArraySpec

Array = np.ndarray[Any, Any]


# ---------------------------------------------------------------------- video arrays
def read_video(artifact: Artifact, name: str, start: int, stop: int, raw: bool = False) -> Array:
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
    if name not in artifact.arrays:
        raise StoreError(f"{artifact.path}: has no array {name}, or artifact.json is damaged; {AGAIN}")
    length = artifact.shape(name)[0]
    if not 0 <= start <= stop <= length:
        raise ValueError(f"{artifact.path}: {name} has {length} rows, asked for {start} to {stop}")
    spec = ArraySpec.from_json(artifact.arrays[name])
    touched = [i for i, (a, b) in enumerate(artifact.parts) if a < stop and b > start]
    stored = [_rows(artifact, spec, part, start, stop) for part in touched]
    if len(stored) == 1:  # most often; no copy
        whole = stored[0]
    else:
        whole = np.concatenate(stored) if stored else np.empty((0, *spec.shape[1:]), spec.dtype)
    return whole if raw else decode(whole, spec.attributes)


def _rows(artifact: Artifact, spec: ArraySpec, part: int, start: int, stop: int) -> Array:
    """Those of the rows ``start`` to ``stop - 1`` that a part holds."""
    first, last = (min(edge, spec.shape[0]) for edge in artifact.parts[part])
    rows = (max(start, first) - first, min(stop, last) - first)
    shape, inside = (first_part(artifact.laid_out), *spec.shape[1:]), artifact.inside
    if rows[0] >= rows[1]:
        return np.empty((0, *spec.shape[1:]), spec.dtype)
    shard = artifact.shard(spec.name, part)
    record = _record(artifact, part)
    for damage in wrong_sizes(artifact, part, record.files, [shard]):
        raise StoreError(f"{damage.path}: {artifact.path.parent.name}, part {part}: {damage.what}; {AGAIN}")

    def read(offset: int, length: int) -> bytes | None:
        return inside.read_range(shard, offset, length)

    try:
        size = record.files[shard]["size"]
        return shards.decode(read, size, rows, shape, spec.chunk, np.dtype(spec.dtype), spec.kind)
    except (ValueError, RuntimeError, OSError) as error:
        damages = wrong_content(artifact, part, record.files, [shard])
        _take_back(artifact, [part] if damages else [])
        what = damages[0].what if damages else f"cannot be read ({error})"
        raise StoreError(f"{artifact.path / shard}: {what}; {AGAIN}") from error


def _record(artifact: Artifact, part: int) -> PartRecord:
    record = artifact.part(part)
    if record is None:
        where = f"{artifact.path}: {artifact.path.parent.name}, part {part}"
        raise StoreError(f"{where}: {part_problem(artifact, part)}; {AGAIN}")
    return record


def _take_back(artifact: Artifact, parts: Sequence[int]) -> None:
    """Best effort: a store may be open for reading only."""
    try:
        artifact.invalidate(parts)
    except OSError:
        return


# ---------------------------------------------------------------------- tables
def blocks(artifact: Artifact, start: int, stop: int) -> list[Block]:
    """The blocks of tables with frames in ``start`` to ``stop - 1``, in order.

    Raises
    ------
    StoreError
        If a part that may hold some is not there.
    """
    found = []
    for part, (a, b) in enumerate(artifact.parts):
        if a < stop and b > start:
            _record(artifact, part)
            found += [block for block in artifact.blocks(part) if block.start < stop and block.stop > start]
    return found


def read_table(artifact: Artifact, block: Block, name: str) -> Array:
    """One table of a block, writable.

    Raises
    ------
    StoreError
        If its file is not as the record says; the part is taken back then, so that the next run redoes it.
    """
    entry, file = block.tables[name], tables_name(block.part)
    content = artifact.inside.read_range(file, entry.offset, entry.length) if entry.length else b""
    if content is not None and len(content) == entry.length and files.crc32(content) == entry.crc32:
        return unpack(content, entry.dtype, entry.shape)
    expected = _record(artifact, block.part).files
    wrong = wrong_sizes(artifact, block.part, expected, [file])
    wrong = wrong or wrong_content(artifact, block.part, expected, [file])
    _take_back(artifact, [block.part])
    what = wrong[0].what if wrong else "could not be read"
    raise StoreError(f"{artifact.path / file}: {what}; {AGAIN}")
