"""One image file: its size as displayed, its pixels, and whether they are all there."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from zsmoseg.errors import VideoError
from zsmoseg.video import places
from zsmoseg.video.bounds import PNG, TooLarge, check_png, check_size, open_image, png_chunk

WIDTH, HEIGHT, ORIENTATION = 0x0100, 0x0101, 0x0112
"""EXIF tags."""
PNG_SIZE = 16
"""Where a PNG says how wide it is."""
MARKER, END = re.compile(rb"\xff+[^\x00\x01\xd0-\xd7\xff]"), 0xD9
"""Of JPEG (ITU-T T.81, B.1.1.3): what begins a segment, also behind the data of a scan; the one that ends the picture."""
BITS = (8, 10, 12, 14, 16)
"""That sensors have."""
SIDEWAYS = 5
"""EXIF orientations from here on swap the sides."""


def image_size(file: str) -> tuple[int, int]:
    """(width, height) as displayed, from the header."""
    try:
        with open(places.here(file), "rb") as stream, open_image(stream) as image:
            tags = exif(image, stream)
            width, height = image.size
            if image.format == "TIFF":  # Pillow may have turned it
                width, height = int(tags[WIDTH]), int(tags[HEIGHT])
            return (height, width) if tags.get(ORIENTATION, 1) >= SIDEWAYS else (width, height)
    except TooLarge as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise unreadable(file) from error


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
    if not content or _cut_off(content):
        return None
    try:
        _check_size(content)
        check_png(content)
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
        return cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except TooLarge as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError, cv2.error):
        return None


def _check_size(content: bytes) -> None:
    """Raise ``TooLarge`` by the head of an image; of JPEG and PNG without Pillow, which takes longer than it needs."""
    if content.startswith(PNG) and len(content) > PNG_SIZE + 8:
        width, height = struct.unpack_from(">II", content, PNG_SIZE)
    elif content.startswith(b"\xff\xd8") and (place := _jpeg_frame(content)):
        height, width = struct.unpack_from(">HH", content, place + 5)
    else:
        with open_image(BytesIO(content)):
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


def _cut_off(content: bytes) -> bool:
    """Whether a JPEG or PNG lacks its end, which decoders fill with grey or black and do not mention."""
    if content.startswith(b"\xff\xd8"):
        return not _jpeg_ends(content)
    return content.startswith(b"\x89PNG") and b"IEND" not in content


def _jpeg_ends(content: bytes) -> bool:
    """Whether the picture is closed: cameras write more behind it, and what stands in segments is none of its end."""
    place = 2
    while found := MARKER.search(content, place):
        place = found.end()
        if content[place - 1] == END:
            return True
        place += int.from_bytes(content[place : place + 2], "big")
    return False


def value_bits(files: Sequence[str]) -> tuple[int, int]:
    """How many bits of images with 16 are used, as cameras fill them, and the largest value; 16 of others."""
    first = pixels(files[0])
    if first is None or first.dtype != np.uint16:
        return BITS[-1], 0
    largest = max(int(image.max()) for image in map(pixels, files) if image is not None)
    return next(bits for bits in BITS if largest < 1 << bits), largest


def unreadable(file: str, why: str = "cannot be read as an image") -> VideoError:
    """The error for an image that cannot be used."""
    return VideoError(f"{file}: {why}; replace it or take it out of the folder")
