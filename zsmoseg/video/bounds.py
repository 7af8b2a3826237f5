"""How large is believed: a size that a file states is compared with these bounds before anything of it is made."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from PIL import Image

SIDE, PIXELS = 1 << 15, 1 << 26
"""px of a side and of an image at most: twice 8K."""
SLIM, LONG = 64, 1024
"""How many times longer one side may be than the other, where it is longer than this (px)."""
BYTES = 1 << 30
"""Of one frame in memory at once, whatever a file holds of it; of a file that is read as a whole twice that."""

MOST_TAGS = 1 << 16
"""Bytes of EXIF, as JPEG bounds them."""

ALSO_TURNED_BY = {"xmp", "XML:com.adobe.xmp", "Raw profile type exif"}
"""Where Pillow looks for an orientation, besides EXIF."""

PNG = b"\x89PNG\r\n\x1a\n"
"""How one begins."""
PNG_END = b"IEND"
"""Its last chunk."""

warnings.filterwarnings("error", category=Image.DecompressionBombWarning)
warnings.filterwarnings(
    "ignore", module=r"PIL\.TiffImagePlugin"
)  # what cannot be read of a head is told in words


class BadHead(ValueError):
    """A file says in its head that it is not for us; says what, and what to do."""


class TooLarge(BadHead):
    """A file states a size that is not believed; says which, and the bound."""


def check_size(height: int, width: int) -> None:
    """Raise ``TooLarge`` if no image of these sides is to be made.

    Examples
    --------
    >>> check_size(100000, 1)
    Traceback (most recent call last):
    zsmoseg.video.bounds.TooLarge: is 1 px wide and 100000 px high; sides may be 1 to 32768 px
    >>> check_size(20000, 20)
    Traceback (most recent call last):
    zsmoseg.video.bounds.TooLarge: is 20 px wide and 20000 px high; one side may be 64 times the other
    """
    short, long = sorted((height, width))
    bound = ""
    if short < 1 or long > SIDE:
        bound = f"sides may be 1 to {SIDE} px"
    elif height * width > PIXELS:
        bound = f"an image may have {PIXELS} px"
    elif long > LONG and long > SLIM * short:
        bound = f"one side may be {SLIM} times the other"
    if bound:
        raise TooLarge(f"is {width} px wide and {height} px high; {bound}")


def check_bytes(count: int, what: str, most: int = BYTES) -> None:
    """Raise ``TooLarge`` if ``what`` is more than may be in memory at once."""
    if count > most:
        raise TooLarge(
            f"{what} would take {count / 1e9:.1f} GB at once; at most {most / 1e9:.1f} GB are read"
        )


def check_png(content: bytes) -> None:
    """Raise ``ValueError`` for a PNG that lacks its end, which decoders make up, or whose chunks state too much, which they allocate."""
    if not content.startswith(PNG):
        return
    chunks = list(_chunks(BytesIO(content)))
    for _, begin, length in chunks:
        if length > len(content) - begin:
            raise ValueError(f"a chunk states {length} bytes, {len(content) - begin} are left")
    if not chunks or chunks[-1][0] != PNG_END:
        raise ValueError("is cut off")


def png_chunk(stream: BinaryIO, kind: bytes) -> bytes:
    """What the first chunk of a kind holds, wherever it stands in a PNG; empty without one.

    Raises
    ------
    ValueError
        If the file ends before its last chunk.
    """
    for found, _, length in _chunks(stream):
        if found == kind:
            return stream.read(min(length, MOST_TAGS))
        if found == PNG_END:
            return b""
    raise ValueError("is cut off")


def _chunks(stream: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
    """Kind, begin and stated length of the content of every chunk of a PNG; the stream stands where it begins.

    What other programs write behind the last counts for nothing.
    """
    begin, kind = len(PNG) + 8, b""
    while kind != PNG_END and stream.seek(begin - 8) and len(head := stream.read(8)) == 8:
        (length,) = struct.unpack_from(">I", head)
        kind = head[4:]
        yield kind, begin, length
        begin += length + 12


@contextmanager
def open_image(source: str | Path | BinaryIO) -> Iterator[Image.Image]:
    """An image whose head was read, of a size that is believed; turned by its EXIF alone, as OpenCV and browsers do.

    Raises
    ------
    TooLarge, OSError, SyntaxError, ValueError
        If it is too large, or none that Pillow knows.
    """
    try:
        image = Image.open(source)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise TooLarge(f"is too large; an image may have {PIXELS} px") from error
    for name in ALSO_TURNED_BY & image.info.keys():
        del image.info[name]
    with image:
        check_size(image.height, image.width)
        yield image
