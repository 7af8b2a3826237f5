"""Shards that are written here are Zarr's, of every codec and type, and the other way round."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import zarr

from zsmoseg.stores import shards
from zsmoseg.stores.artifact import chunk_name
from zsmoseg.stores.fields import Codec
from zsmoseg.stores.schema import ArraySpec

DTYPES: dict[Codec, list[str]] = {
    "image": ["uint8", "bool", "uint16", "float32", "float64"],
    "flow": ["int16", "float16"],
    "label": ["uint16", "uint32", "int64", "bool"],
}


def test_every_codec_is_tested() -> None:
    assert set(DTYPES) == set(get_args(Codec))


def drawn(dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    """Never all of one value: Zarr leaves such pieces out."""
    return (np.arange(np.prod(shape)).reshape(shape) * 37 % 251).astype(dtype)


def lay_out(path: Path, kind: Codec, dtype: str, frames: int, length: int) -> tuple[ArraySpec, Any]:
    """An array as stores describe it, opened by Zarr."""
    size = (2, 5, 3) if kind == "flow" else (5, 3)
    dims = ("pair", "component", "y", "x") if kind == "flow" else ("frame", "y", "x")
    spec = ArraySpec("a", dims, (frames, *size), dtype, kind=kind)
    path.mkdir()
    (path / "zarr.json").write_text(json.dumps(spec.metadata(length)))
    return spec, zarr.open_array(path)


def read(data: bytes, spec: ArraySpec, length: int, first: int, last: int) -> np.ndarray:
    """Some rows of a shard."""

    def some(offset: int, size: int) -> bytes:
        return data[offset : offset + size]

    full = (length, *spec.shape[1:])
    return shards.decode(some, len(data), (first, last), full, spec.chunk, np.dtype(spec.dtype), spec.kind)


@pytest.mark.parametrize(("kind", "dtype"), [(kind, dtype) for kind in DTYPES for dtype in DTYPES[kind]])
@pytest.mark.parametrize(("frames", "length"), [(7, 3), (6, 3), (1, 1), (2, 5)])
def test_shards_of_every_codec_are_those_of_zarr(
    kind: Codec, dtype: str, frames: int, length: int, tmp_path: Path
) -> None:
    spec, ours = lay_out(tmp_path / "ours", kind, dtype, frames, length)
    _, theirs = lay_out(tmp_path / "theirs", kind, dtype, frames, length)
    whole = drawn(dtype, spec.shape)
    theirs[:] = whole
    for part, start in enumerate(range(0, frames, length)):
        rows, name = whole[start : start + length], chunk_name(part, whole.ndim)
        data = shards.encode(rows, spec.chunk, length, kind)
        (tmp_path / "ours" / name).write_bytes(data)
        for written in (data, (tmp_path / "theirs" / name).read_bytes()):
            for first in range(len(rows) + 1):
                np.testing.assert_array_equal(read(written, spec, length, first, len(rows)), rows[first:])
    np.testing.assert_array_equal(ours[:], whole)
    np.testing.assert_array_equal(ours[-1:], whole[-1:])


@pytest.mark.parametrize("kind", DTYPES)
def test_bytes_do_not_depend_on_how_rows_lie_in_memory(kind: Codec, tmp_path: Path) -> None:
    spec, _ = lay_out(tmp_path / "a", kind, DTYPES[kind][0], 3, 4)
    rows = drawn(spec.dtype, spec.shape)
    data = shards.encode(rows, spec.chunk, 4, kind)
    for same in (rows.astype(rows.dtype.newbyteorder(">")), np.asfortranarray(rows), rows[::-1].copy()[::-1]):
        assert shards.encode(same, spec.chunk, 4, kind) == data


@pytest.mark.parametrize("kind", DTYPES)
def test_no_byte_of_a_shard_can_change_a_value(kind: Codec, tmp_path: Path) -> None:
    spec, _ = lay_out(tmp_path / "a", kind, "int16", 3, 4)
    data = shards.encode(drawn("int16", spec.shape), spec.chunk, 4, kind)
    for place in range(len(data)):
        changed = bytearray(data)
        changed[place] ^= 1 << place % 8
        for harmed in (bytes(changed), data[:place]):
            with pytest.raises((ValueError, RuntimeError)):
                read(harmed, spec, 4, 0, 3)
