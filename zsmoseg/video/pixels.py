"""One image file: its size as displayed, its pixels, and whether they are all there."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from zsmoseg.errors import VideoError
from zsmoseg.video import places
from zsmoseg.video.bounds import PNG, BadHead, check_png, check_size, open_image, png_chunk
from zsmoseg.video.heads import HEIGHT, WIDTH, check_numbers, check_single, depth

# What it cannot read is told here, in words.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

ORIENTATION = 0x0112
"""EXIF tag."""
PNG_SIZE = 16
"""Where a PNG says how wide it is."""
JPEG = b"\xff\xd8"
"""How one begins."""
MARKER, END = re.compile(rb"\xff+[^\x00\x01\xd0-\xd7\xff]"), 0xD9
"""Of JPEG (ITU-T T.81, B.1.1.3): what begins a segment, also behind the data of a scan; the one that ends the picture."""
BITS = (8, 10, 12, 14, 16)
"""That sensors have."""
SIDEWAYS = 5
"""EXIF orientations from here on swap the sides."""


def image_size(file: str) -> tuple[int, int]:
    """(width, height) as displayed, from the header."""
    try:
        with open(places.here(file), "rb") as stream, _opened(stream) as image:
            check_single(image, stream)
            tags = exif(image, stream)
            width, height = image.size
            if image.format == "TIFF":  # Pillow may have turned it
                width, height = int(tags[WIDTH]), int(tags[HEIGHT])
            return (height, width) if tags.get(ORIENTATION, 1) >= SIDEWAYS else (width, height)
    except BadHead as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise unreadable(file) from error


@contextmanager
def _opened(stream: BinaryIO) -> Iterator[Image.Image]:
    """As ``open_image``, of numbers that are read here: Pillow says of others only that it knows none such."""
    check_numbers(stream)
    with open_image(stream) as image:
        yield image


def exif(image: Image.Image, stream: BinaryIO) -> Image.Exif:
    """The EXIF of an image, wherever it stands in its file; Pillow decodes a whole PNG to look behind its pixels."""
    if image.format != "PNG":
        return image.getexif()
    tags = Image.Exif()
    tags.load(image.info.get("exif") or png_chunk(stream, b"eXIf"))
    return tags


def pixels(file: str) -> NDArray[Any] | None:
    """(H, W, 3) as displayed, at the depth of the file; None where it is no image or cut off."""
    try:
        content = Path(places.here(file)).read_bytes()
    except OSError as error:
        raise unreadable(file, f"cannot be read ({error.strerror})") from error
    if not content or (content.startswith(JPEG) and not _jpeg_ends(content)):
        return None
    try:
        _check_head(content)
        check_png(content)
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
        return cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except BadHead as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError, cv2.error):
        return None


def _check_head(content: bytes) -> None:
    """Raise ``BadHead`` by the head of an image; of JPEG and PNG without Pillow, which takes longer than it needs."""
    if content.startswith(PNG) and len(content) > PNG_SIZE + 8:
        width, height = struct.unpack_from(">II", content, PNG_SIZE)
    elif content.startswith(JPEG) and (place := _jpeg_frame(content)):
        height, width = struct.unpack_from(">HH", content, place + 5)
    else:
        with _opened(BytesIO(content)):
            return
    check_size(height, width)


def _jpeg_frame(content: bytes) -> int | None:
    """Where the head of the frame begins (ITU-T T.81, B.2.2: markers C0 to CF that say how it is coded)."""
    place = 2
    while place + 9 <= len(content) and content[place] == 0xFF:
        marker = content[place + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return place
        filled = marker == 0xFF
        place += 1 if filled else 2 + int.from_bytes(content[place + 2 : place + 4])
    return None


def _jpeg_ends(content: bytes) -> bool:
    """Whether the picture is closed, which decoders fill with grey otherwise: cameras write more behind it, and what stands in segments is none of its end."""
    place = 2
    while found := MARKER.search(content, place):
        place = found.end()
        if content[place - 1] == END:
            return True
        place += int.from_bytes(content[place : place + 2], "big")
    return False


def value_bits(files: Sequence[str]) -> tuple[int, int]:
    """How many bits of those images with 16 are used, as cameras fill them, and the largest value; 16 where there are none."""
    largest = 0
    for file in filter(_is_deep, files):
        image = pixels(file)
        if image is not None and image.dtype == np.uint16:
            largest = max(largest, int(image.max()))
    return (next(bits for bits in BITS if largest < 1 << bits) if largest else BITS[-1]), largest


def _is_deep(file: str) -> bool:
    with open(places.here(file), "rb") as stream:
        return depth(stream) > BITS[0]


def unreadable(file: str, why: str = "cannot be read as an image") -> VideoError:
    """The error for an image that cannot be used."""
    return VideoError(f"{file}: {why}; replace it or take it out of the folder")
