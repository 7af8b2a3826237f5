"""Reading arrays of an artifact: only what a record vouches for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import PurePath
from typing import Any

import numpy as np

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import AGAIN, Artifact, Block
from zsmoseg.stores.checks import Damage, part_problem, wrong_content, wrong_sizes
from zsmoseg.stores.files import Stat
from zsmoseg.stores.fixedpoint import decode
from zsmoseg.stores.packing import unpack
from zsmoseg.stores.schema import load_zarr

Array = np.ndarray[Any, Any]


def open_array(artifact: Artifact, name: str) -> Any:
    """The Zarr array ``name`` for reading and writing, opened once as long as its metadata stay the same.

    Raises
    ------
    StoreError
        If its metadata are missing or damaged.
    """
    path = artifact.path / name
    signature = files.signature(path / "zarr.json")
    try:
        return _open(path, signature)
    except Exception as error:
        raise StoreError(f"{path / 'zarr.json'}: is missing or damaged ({error}); {AGAIN}") from error


@lru_cache(maxsize=256)
def _open(path: PurePath, signature: Stat | None) -> Any:
    array = load_zarr().open_array(files.zarr_store(path), mode="r+")
    return array.with_config({"write_empty_chunks": True})


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
    touched = [i for i, (a, b) in enumerate(artifact.parts) if a < stop and b > start]
    for part in touched:
        _refuse_wrong_shard(artifact, name, part)
    array = open_array(artifact, name)
    try:
        stored = array[start:stop]
    except (ValueError, RuntimeError, OSError) as error:
        _name_the_culprit(artifact, name, touched)
        raise StoreError(f"{artifact.path / name}: cannot be read ({error}); {AGAIN}") from error
    return stored if raw else decode(stored, array.attrs)


def _refuse_wrong_shard(artifact: Artifact, name: str, part: int) -> None:
    record = _record(artifact, part)
    shard = artifact.shard(name, part).relative_to(artifact.path).as_posix()
    for damage in wrong_sizes(artifact, part, record.files, [shard]):
        raise StoreError(f"{damage.path}: {artifact.path.parent.name}, part {part}: {damage.what}; {AGAIN}")


def _record(artifact: Artifact, part: int) -> Any:
    record = artifact.part(part)
    if record is None:
        where = f"{artifact.record_path(part)}: {artifact.path.parent.name}, part {part}"
        raise StoreError(f"{where}: {part_problem(artifact, part)}; {AGAIN}")
    return record


def _name_the_culprit(artifact: Artifact, name: str, parts: Sequence[int]) -> None:
    """Take back the parts whose shard was changed after it was written, so that the next run redoes them."""
    changed: list[Damage] = []
    for part in parts:
        shard = artifact.shard(name, part).relative_to(artifact.path).as_posix()
        changed += wrong_content(artifact, part, _record(artifact, part).files, [shard])
    _take_back(artifact, [damage.part for damage in changed if damage.part is not None])
    for damage in changed:
        raise StoreError(f"{damage.path}: {damage.what}; {AGAIN}")


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
    entry, path = block.tables[name], artifact.tables_path(block.part)
    content = files.read_range(path, entry.offset, entry.length)
    if content is not None and len(content) == entry.length and files.crc32(content) == entry.crc32:
        return unpack(content, entry.dtype, entry.shape)
    expected = _record(artifact, block.part).files
    names = [path.relative_to(artifact.path).as_posix()]
    wrong = wrong_sizes(artifact, block.part, expected, names)
    wrong = wrong or wrong_content(artifact, block.part, expected, names)
    _take_back(artifact, [block.part])
    what = wrong[0].what if wrong else "could not be read"
    raise StoreError(f"{path}: {what}; {AGAIN}")
