"""What the head of an image file says of its pixels: how many pictures there are, and of which numbers."""

from __future__ import annotations

from collections.abc import Iterator
from io import SEEK_END
from itertools import islice
from typing import BinaryIO

from PIL import Image
from PIL.TiffImagePlugin import PREFIXES, ImageFileDirectory_v2

from zsmoseg.video.bounds import PNG, BadHead

WIDTH, HEIGHT, SUBFILE, BITS, KIND = 256, 257, 254, 258, 339
"""TIFF tags (TIFF 6.0, section 8 and 19)."""
NOT_MAIN = 0b101
"""Of SUBFILE: a smaller copy of another picture, or a mask of it."""
KINDS = {3: "floating point", 5: "complex", 6: "complex"}
"""Of numbers that are not whole, as KIND calls them."""
PNG_BITS = 24
"""Where a PNG says how many bits a value has."""
MOST_BITS = 16
BIG = 43
"""Of the head of a TIFF with places of 64 bits."""


def check_single(image: Image.Image, stream: BinaryIO) -> None:
    """Raise ``BadHead`` if a file holds more than one picture: an animation, or pages of one size."""
    several = image.format in ("PNG", "WEBP") and bool(getattr(image, "is_animated", False))
    main = (page for page in _pages(stream) if not _numbers(page, SUBFILE)[0] & NOT_MAIN)
    sizes = (_numbers(page, WIDTH) + _numbers(page, HEIGHT) for page in main)
    first = next(sizes, ())
    if several or any(size == first for size in sizes):
        raise BadHead("holds several pictures, one a frame is expected")


def check_numbers(stream: BinaryIO) -> None:
    """Raise ``BadHead`` if the values of a TIFF are no whole numbers of up to 16 bits."""
    bits, kind = depth(stream), 0
    for page in islice(_pages(stream), 1):
        kind = max(_numbers(page, KIND))
    if bits > MOST_BITS or kind in KINDS:
        kinds = f"{KINDS[kind]} " if kind in KINDS else ""
        raise BadHead(f"has {kinds}values of {bits} bits, whole numbers of 8 or 16 are expected")


def depth(stream: BinaryIO) -> int:
    """Bits of a value of a PNG or TIFF; 8 of others."""
    stream.seek(0)
    head = stream.read(PNG_BITS + 1)
    if head.startswith(PNG) and len(head) > PNG_BITS:
        return head[PNG_BITS]
    return next((max(_numbers(page, BITS)) for page in _pages(stream)), 8)


def _numbers(page: ImageFileDirectory_v2, tag: int) -> tuple[int, ...]:
    """What a tag says, 0 where it is not there or no number."""
    said = page.get(tag)
    numbers = said if isinstance(said, tuple) else (said,)
    return tuple(number for number in numbers if isinstance(number, int)) or (0,)


def _pages(stream: BinaryIO) -> Iterator[ImageFileDirectory_v2]:
    """The directories of a TIFF, one after another in one object; none of other files.

    Raises
    ------
    ValueError
        If the first begins behind the end of the file.
    """
    size = stream.seek(0, SEEK_END)
    stream.seek(0)
    head = stream.read(16)
    if len(head) < 16 or not head.startswith(tuple(PREFIXES)):
        return
    tags, seen = ImageFileDirectory_v2(head if BIG in head[2:4] else head[:8]), {0}
    if tags.next >= size:
        raise ValueError("is cut off")
    while tags.next not in seen and tags.next < size:
        seen.add(tags.next)
        stream.seek(tags.next)
        tags.load(stream)
        yield tags
