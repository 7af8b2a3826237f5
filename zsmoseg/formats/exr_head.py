"""The head of an OpenEXR file, as far as its size is concerned: OpenCV makes what it states without a question."""

from __future__ import annotations

import struct
from pathlib import Path

from zsmoseg.video.bounds import check_size

MAGIC = b"\x76\x2f\x31\x01"
HEAD = 1 << 16
"""Bytes that the head may have."""
WINDOW = b"dataWindow"


def check_exr(path: Path) -> None:
    """Raise ``ValueError`` if it is none, or of a size that is not believed.

    References
    ----------
    "OpenEXR file layout", openexr.com: attributes are name, type, size and value until an empty name.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
    if not head.startswith(MAGIC):
        raise ValueError("is no OpenEXR file")
    found, place = {}, 8
    while head[place : place + 1] not in (b"", b"\0"):
        name = head[place : head.index(b"\0", place)]
        kind_end = head.index(b"\0", place + len(name) + 1)
        (size,) = struct.unpack_from("<i", head.ljust(kind_end + 5, b"\0"), kind_end + 1)
        if size < 0:
            raise ValueError("its head is damaged")
        found[name] = head[kind_end + 5 : kind_end + 5 + size]
        place = kind_end + 5 + size
    if len(found.get(WINDOW, b"")) != 16:
        raise ValueError("its head is damaged")
    left, top, right, bottom = struct.unpack("<4i", found[WINDOW])
    check_size(bottom - top + 1, right - left + 1)
