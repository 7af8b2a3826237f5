"""Shards of video arrays as bytes and back, without importing Zarr: its codec ``sharding_indexed``, index at the end.

A shard holds the rows of one part, each row in pieces that are compressed alone. Zarr's own way takes several
milliseconds for a shard of any size, which is more than a task of a short video takes; the tests read with Zarr what is
written here. Only codecs of Zarr's specification, so that any reader can open them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numcodecs import blosc, zstd  # type: ignore[import-untyped,unused-ignore]

from zsmoseg.stores.fields import Codec
from zsmoseg.stores.packing import CRC, CRC_BYTES, LITTLE, sealed, unsealed

Array = np.ndarray[Any, Any]
Read = Callable[[int, int], bytes | None]
"""Reads (offset, length) of a file; None where it cannot."""

_ENTRY = 16
"""Bytes of an entry of the index: where a piece begins, how long it is."""


@cache
def _compressor(codec: Codec) -> Any:
    """LZ4 for images and flow: half the time of zstd 1 for 14 % (images) and 28 % (flow) more bytes. Zstd for
    labels: half of the bytes of LZ4 for a third more time. (Frames and flow of three DAVIS sequences.)
    """
    if codec == "label":
        return zstd.Zstd(level=1, checksum=True)
    return blosc.Blosc(cname="lz4", clevel=5, shuffle=blosc.SHUFFLE)


def codecs(codec: Codec, piece: Sequence[int], itemsize: int) -> list[dict[str, Any]]:
    """The codecs of an array of shards as its ``zarr.json`` has them; the checksum covers what is on disk."""
    if codec == "label":
        packed: dict[str, Any] = {"name": "zstd", "configuration": {"level": 1, "checksum": True}}
    else:
        how = {"typesize": itemsize, "cname": "lz4", "clevel": 5, "shuffle": "shuffle", "blocksize": 0}
        packed = {"name": "blosc", "configuration": how}
    inside = {"chunk_shape": list(piece), "codecs": [LITTLE, packed, CRC]}
    index = {"index_codecs": [LITTLE, CRC], "index_location": "end"}
    return [{"name": "sharding_indexed", "configuration": {**inside, **index}}]


def encode(values: Array, piece: Sequence[int], length: int, codec: Codec) -> bytes:
    """A shard.

    Parameters
    ----------
    values
        The rows, at most ``length`` of them.
    piece
        Shape of what is compressed at once: 1 along the first dimensions, all along the others.
    length
        Rows of a full shard.
    """
    plain = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).reshape(-1, int(np.prod(piece)))
    compressor = _compressor(codec)
    found = [sealed(bytes(compressor.encode(row))) for row in plain]
    index = np.full((length * _per_row(values.shape, piece), 2), 2**64 - 1, "<u8")
    sizes = np.array([len(content) for content in found], np.uint64)
    index[: len(found), 0] = np.cumsum(sizes) - sizes
    index[: len(found), 1] = sizes
    return b"".join([*found, sealed(index.tobytes())])


def _per_row(shape: Sequence[int], piece: Sequence[int]) -> int:
    return int(np.prod(shape[1:])) // int(np.prod(piece))


def decode(
    read: Read,
    size: int,
    rows: tuple[int, int],
    shape: Sequence[int],
    piece: Sequence[int],
    dtype: np.dtype[Any],
    codec: Codec,
) -> Array:
    """Some rows of a shard.

    Parameters
    ----------
    read, size
        The file, and its size in bytes.
    rows
        First row and end.
    shape
        Of a full shard.

    Raises
    ------
    ValueError
        If the bytes are not those that were written.
    """
    first, last = rows
    out = np.empty((last - first, *shape[1:]), dtype.newbyteorder("<"))
    per_row = _per_row(shape, piece)
    places = _index(read, size, shape[0] * per_row)[first * per_row : last * per_row]
    if not len(places):
        return out
    begin, end = int(places[:, 0].min()), int(places.sum(1).max())
    if end > size:
        raise ValueError("its index points behind its end")
    content = read(begin, end - begin) or b""
    pieces = out.reshape(len(places), -1)
    compressor = _compressor(codec)
    for (offset, length), target in zip(places.tolist(), pieces, strict=True):
        compressor.decode(unsealed(content[offset - begin : offset - begin + length]), target.view(np.uint8))
    return out


def _index(read: Read, size: int, count: int) -> Array:
    """(count, 2) offset and length of every piece."""
    length = count * _ENTRY + CRC_BYTES
    content = unsealed(read(size - length, length) or b"") if size >= length else b""
    if len(content) != count * _ENTRY:
        raise ValueError("its index is cut off")
    return np.frombuffer(content, "<u8").reshape(count, 2)
