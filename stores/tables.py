"""One table as a Zarr v3 array of one chunk: bytes from arrays and back, without importing Zarr.

A part has dozens of small tables, and Zarr's own way takes several times as long for each. What is written
is plain Zarr v3; the tests read it with Zarr.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import google_crc32c
import numpy as np
from numcodecs import blosc  # type: ignore[import-untyped,unused-ignore]

Array = np.ndarray[Any, Any]

blosc.use_threads = False
_COMPRESSOR = blosc.Blosc(cname="zstd", clevel=1, shuffle=blosc.SHUFFLE)
GROUP = b'{"attributes":{},"node_type":"group","zarr_format":3}'
"""The ``zarr.json`` of a group."""


def chunk_name(dimensions: int) -> str:
    """What the file of the one chunk is called: beside its ``zarr.json``, as folders cost more than files."""
    return "c" + ".0" * dimensions


def pack(values: Array, dims: Sequence[str]) -> tuple[bytes, bytes | None]:
    """A table as bytes.

    Parameters
    ----------
    values
        Booleans, integers or floating numbers, any shape.
    dims
        Name of each dimension.

    Returns
    -------
    metadata, chunk
        Content of ``zarr.json``, and of the one chunk; None where there is no element.

    Raises
    ------
    TypeError
        If the values are of another kind: text, times, objects.
    """
    if values.dtype.kind not in "biuf" or values.dtype.itemsize > 8:
        raise TypeError(f"expected booleans, integers or floating numbers, got {values.dtype}")
    if len(dims) != values.ndim:
        raise ValueError(f"dims {tuple(dims)} do not name the dimensions of shape {values.shape}")
    text = json.dumps(_metadata(values, dims), sort_keys=True, separators=(",", ":"), allow_nan=False)
    if not values.size:
        return text.encode(), None
    plain = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1)
    chunk = _COMPRESSOR.encode(plain.view(np.uint8) if plain.dtype == np.bool_ else plain)
    return text.encode(), chunk + google_crc32c.value(chunk).to_bytes(4, "little")


def unpack(metadata: bytes, chunk: bytes | None) -> tuple[Array, tuple[str, ...]]:
    """What ``pack`` made: the table, writable, and the names of its dimensions.

    Raises
    ------
    ValueError
        If these are not bytes that ``pack`` made.
    """
    described = json.loads(metadata)
    shape = tuple(described["shape"])
    dtype = np.dtype(described["data_type"]).newbyteorder("<")
    dims = tuple(described["dimension_names"])
    if chunk is None:
        return np.zeros(shape, dtype), dims
    if google_crc32c.value(chunk[:-4]).to_bytes(4, "little") != chunk[-4:]:
        raise ValueError("stored and computed checksum do not match")
    out = np.empty(shape, dtype)
    _COMPRESSOR.decode(chunk[:-4], out.reshape(-1).view(np.uint8))
    return out, dims


def _metadata(values: Array, dims: Sequence[str]) -> dict[str, Any]:
    chunk = [max(length, 1) for length in values.shape]
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(values.shape),
        "data_type": values.dtype.name,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": {"b": False, "f": 0.0}.get(values.dtype.kind, 0),
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {
                "name": "blosc",
                "configuration": {
                    "typesize": values.dtype.itemsize,
                    "cname": "zstd",
                    "clevel": 1,
                    "shuffle": "shuffle",
                    "blocksize": 0,
                },
            },
            {"name": "crc32c"},
        ],
        "attributes": {},
        "dimension_names": list(dims),
        "storage_transformers": [],
    }
