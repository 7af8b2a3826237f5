"""Reading arrays of an artifact: only what a record vouches for."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.checks import wrong_content, wrong_sizes
from zsmoseg.stores.fixedpoint import decode
from zsmoseg.stores.schema import load_zarr

if TYPE_CHECKING:
    from zsmoseg.stores.artifact import Artifact, PartRecord

Array = np.ndarray[Any, Any]
AGAIN = "run the same command again"


def open_array(artifact: Artifact, name: str) -> Any:
    """The Zarr array ``name`` for reading and writing, opened once as long as its metadata stay the same.

    Raises
    ------
    StoreError
        If its metadata are missing or damaged.
    """
    path = artifact.data / name
    signature = files.signature(path / "zarr.json")
    try:
        return _open(path, signature)
    except Exception as error:
        raise StoreError(f"{path / 'zarr.json'}: is missing or damaged ({error}); {AGAIN}") from error


@lru_cache(maxsize=256)
def _open(path: Path, signature: tuple[int, int, int] | None) -> Any:
    array = load_zarr().open_array(path, mode="r+")
    return array.with_config({"write_empty_chunks": True})


def read(artifact: Artifact, name: str, start: int, stop: int, raw: bool) -> Array:
    """See ``Artifact.read``."""
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
        raise StoreError(f"{artifact.data / name}: cannot be read ({error}); {AGAIN}") from error
    return stored if raw else decode(stored, array.attrs)


def _refuse_wrong_shard(artifact: Artifact, name: str, part: int) -> None:
    where = f"{artifact.path.parent.name}, part {part}"
    if artifact.part(part) is None:
        raise StoreError(f"{artifact.record_path(part)}: {where}: {artifact.part_problem(part)}; {AGAIN}")
    shard = artifact.shard(name, part)
    for damage in wrong_sizes(artifact, part, [shard.relative_to(artifact.path).as_posix()]):
        raise StoreError(f"{damage.path}: {where}: {damage.what}; {AGAIN}")


def _name_the_culprit(artifact: Artifact, name: str, parts: list[int]) -> None:
    """Take back the parts whose shard was changed after it was written, so that the next run redoes them."""
    shards = {part: [artifact.shard(name, part).relative_to(artifact.path).as_posix()] for part in parts}
    changed = [damage for part, names in shards.items() for damage in wrong_content(artifact, part, names)]
    _take_back(artifact, [damage.part for damage in changed if damage.part is not None])
    for damage in changed:
        raise StoreError(f"{damage.path}: {damage.what}; {AGAIN}")


def _take_back(artifact: Artifact, parts: list[int]) -> None:
    """Best effort: a store may be open for reading only."""
    try:
        artifact.invalidate(parts)
    except OSError:
        return


def read_tables(artifact: Artifact, part: int, group: str) -> dict[str, tuple[Array, tuple[str, ...]]]:
    """The tables of a group of a part and the names of their dimensions; every file against its checksum.

    Raises
    ------
    StoreError
        See ``Artifact.read_table``.
    """
    from zsmoseg.stores.tables import unpack

    record = artifact.part(part)
    if record is None:
        raise StoreError(f"{artifact.record_path(part)}: {artifact.part_problem(part)}; {AGAIN}")
    if group and group not in record.tables:
        raise StoreError(f"{artifact.path}: part {part} has no tables {group}")
    folder = (artifact.table_folder(part) / group).relative_to(artifact.path).as_posix()
    found = {}
    for name, chunk in record.tables.get(group, {}).items():
        metadata = _content(artifact, part, record, f"{folder}/{name}/zarr.json")
        data = None if chunk is None else _content(artifact, part, record, chunk)
        found[name] = unpack(metadata, data)
    return found


def _content(artifact: Artifact, part: int, record: PartRecord, name: str) -> bytes:
    content = files.read(artifact.path / name)
    if content is not None and files.crc32(content) == record.files[name]["crc32"]:
        return content
    wrong = wrong_sizes(artifact, part, [name]) or wrong_content(artifact, part, [name])
    _take_back(artifact, [part])
    what = wrong[0].what if wrong else "could not be read"
    raise StoreError(f"{artifact.path / name}: {what}; {AGAIN}")
