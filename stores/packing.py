"""Tables as bytes and back, without importing Zarr: packed for the file of a part, or as a whole Zarr v3 array.

A part has dozens of small tables, and Zarr's own way takes several times as long for each. What is written for
readers is plain Zarr v3; the tests read it with Zarr.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import google_crc32c
import numpy as np
from numcodecs import blosc  # type: ignore[import-untyped,unused-ignore]

Array = np.ndarray[Any, Any]

blosc.use_threads = False
_COMPRESSOR = blosc.Blosc(cname="zstd", clevel=1, shuffle=blosc.SHUFFLE)
_BLOSC = {"cname": "zstd", "clevel": 1, "shuffle": "shuffle", "blocksize": 0}
CRC = {"name": "crc32c"}
LITTLE = {"name": "bytes", "configuration": {"endian": "little"}}
CRC_BYTES = 4


def pack(values: Array) -> bytes:
    """A table compressed, with its checksum at the end; nothing where it has no element.

    Raises
    ------
    TypeError
        If the values are no booleans, integers or floating numbers: text, times, objects.
    """
    if values.dtype.kind not in "biuf" or values.dtype.itemsize > 8:
        raise TypeError(f"expected booleans, integers or floating numbers, got {values.dtype}")
    if not values.size:
        return b""
    plain = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1)
    return sealed(bytes(_COMPRESSOR.encode(plain.view(np.uint8) if plain.dtype == np.bool_ else plain)))


def unpack(content: bytes, dtype: str, shape: Sequence[int]) -> Array:
    """What ``pack`` made: the table, writable.

    Raises
    ------
    ValueError
        If these are not bytes that ``pack`` made.
    """
    out = np.empty(tuple(shape), np.dtype(dtype).newbyteorder("<"))
    if not out.size:
        return out
    _COMPRESSOR.decode(unsealed(content), out.reshape(-1).view(np.uint8))
    return out


def pack_text(values: Sequence[str]) -> bytes:
    """Text as the codec ``vlen-utf8`` has it: the number of strings, then length and bytes of each."""
    encoded = [value.encode() for value in values]
    pieces = [struct.pack("<I", len(encoded))]
    for text in encoded:
        pieces += [struct.pack("<I", len(text)), text]
    return sealed(b"".join(pieces))


def sealed(content: bytes) -> bytes:
    """With its checksum at the end, as Zarr's codec ``crc32c`` has it."""
    end: bytes = google_crc32c.value(content).to_bytes(CRC_BYTES, "little")
    return content + end


def unsealed(content: bytes) -> bytes:
    """Without its checksum.

    Raises
    ------
    ValueError
        If that is another one.
    """
    body, end = content[:-CRC_BYTES], content[-CRC_BYTES:]
    if google_crc32c.value(body).to_bytes(CRC_BYTES, "little") != end:
        raise ValueError("stored and computed checksum do not match")
    return body


def codecs(dtype: np.dtype[Any] | None) -> list[dict[str, Any]]:
    """The codecs of what ``pack`` makes as ``zarr.json`` has them, or ``pack_text`` where ``dtype`` is None."""
    if dtype is None:
        return [{"name": "vlen-utf8"}, CRC]
    # Blosc wants the size of what it shuffles
    return [LITTLE, {"name": "blosc", "configuration": {"typesize": dtype.itemsize, **_BLOSC}}, CRC]


def metadata(
    dtype: np.dtype[Any] | None,
    shape: Sequence[int],
    chunk: Sequence[int],
    dims: Sequence[str],
    fill: float,
    attributes: Mapping[str, Any],
    packed: Sequence[Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """The ``zarr.json`` of an array; ``dtype`` None: text; ``packed``: its codecs, without them those of ``pack``."""
    kind = "s" if dtype is None else dtype.kind
    unknown: dict[str, Any] = {"b": bool(fill == 1), "f": _float(fill), "s": ""}
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shape),
        "data_type": "string" if dtype is None else dtype.name,
        "chunk_grid": {
            "name": "regular",
            "configuration": {"chunk_shape": [max(length, 1) for length in chunk]},
        },
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": unknown[kind] if kind in unknown else int(fill),
        "codecs": list(codecs(dtype) if packed is None else packed),
        "attributes": dict(attributes),
        "dimension_names": list(dims),
        "storage_transformers": [],
    }


def _float(fill: float) -> float | str:
    """JSON has no NaN: Zarr spells it."""
    return "NaN" if np.isnan(fill) else float(fill)


def group_bytes(attributes: Mapping[str, Any], arrays: Mapping[str, bytes]) -> bytes:
    """The ``zarr.json`` of the group of ``arrays`` (their own by name), which it repeats: one file opens them all."""
    root = {"zarr_format": 3, "node_type": "group", "attributes": attributes}
    known = b", ".join(b'"%s": %s' % (name.encode(), arrays[name]) for name in sorted(arrays))
    consolidated = b'{"kind": "inline", "must_understand": false, "metadata": {%s}}' % known
    return b'{"consolidated_metadata": %s, %s' % (consolidated, json_bytes(root)[1:])


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """Canonical."""
    return json.dumps(content, sort_keys=True, allow_nan=False).encode()


def pieces(rows: Iterable[Array], length: int) -> Iterable[Array]:
    """Rows as they come, in blocks of ``length`` rows; the last one may be shorter."""
    waiting: list[Array] = []
    count = 0
    for block in rows:
        start = 0
        while count + len(block) - start >= length:
            stop = start + length - count
            yield np.concatenate([*waiting, block[start:stop]])
            waiting, count, start = [], 0, stop
        if start < len(block):
            waiting.append(block[start:])
            count += len(block) - start
    if count:
        yield np.concatenate(waiting)
