"""Whether the end of a video file is missing, by the sizes that its container states."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import BinaryIO

from zsmoseg.video import places

EBML, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
"""Identifiers of Matroska and WebM (RFC 8794, RFC 9559)."""
UNKNOWN = {0, (1 << 32) - 1}
"""Lengths of a RIFF that who wrote it did not come back to."""
Chunk = Callable[[BinaryIO], "int | None"]
"""The length of the chunk that begins where a file stands; None where it does not say."""


def is_cut_off(path: str, container: str) -> bool:
    """Whether a file ends before what it says it holds; false where its container does not say.

    Parameters
    ----------
    container : FFmpeg's name of the format.
    """
    length_of = next((chunk for name, chunk in CHUNKS.items() if name in container), None)
    if length_of is None:
        return False
    with open(places.here(path), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        while file.tell() < size:
            start = file.tell()
            length = length_of(file)
            if length is None:
                return False
            if start + length > size:
                return True
            file.seek(start + length)
    return False


def _box(file: BinaryIO) -> int | None:
    """ISO 14496-12, 4.2: size and kind, the size in 64 bits where it is 1, up to the end where it is 0."""
    head = file.read(16)
    length = int.from_bytes(head[:4], "big")
    if length == 1:
        length = int.from_bytes(head[8:], "big")
    return length if length >= 8 and head[4:8].isalnum() else None


def _element(file: BinaryIO) -> int | None:
    """RFC 8794, 6: the first bit that is set says how many bytes the size has; all ones: unknown."""
    name = file.read(4)
    first = file.read(1)
    if name not in (EBML, SEGMENT) or not first or not first[0]:
        return None
    more = 8 - first[0].bit_length()
    bits = 7 * (more + 1)
    length = int.from_bytes(first + file.read(more), "big") & ((1 << bits) - 1)
    return None if length == (1 << bits) - 1 else 4 + 1 + more + length


def _riff(file: BinaryIO) -> int | None:
    """Name and size of the rest, little endian; one after another in large files; all ones or 0 where it was written to a pipe."""
    head = file.read(8)
    length = int.from_bytes(head[4:], "little")
    return 8 + length if head.startswith(b"RIFF") and length not in UNKNOWN else None


CHUNKS: dict[str, Chunk] = {"mp4": _box, "matroska": _element, "avi": _riff}
"""By a part of FFmpeg's name of the container."""
