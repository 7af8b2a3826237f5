"""One image file: its size as displayed, its pixels, and whether they are all there."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import VideoError
from zsmoseg.video import places
from zsmoseg.video.bounds import TooLarge, check_size, open_image

WIDTH, HEIGHT, ORIENTATION = 0x0100, 0x0101, 0x0112
"""EXIF tags."""
PNG_SIZE = 16
"""Where a PNG says how wide it is."""
SIDEWAYS = 5
"""EXIF orientations from here on swap the sides."""


def image_size(file: str) -> tuple[int, int]:
    """(width, height) as displayed, from the header."""
    try:
        with open_image(places.here(file)) as image:
            tags = image.getexif()
            width, height = image.size
            if image.format == "TIFF":  # Pillow may have turned it
                width, height = int(tags[WIDTH]), int(tags[HEIGHT])
            return (height, width) if tags.get(ORIENTATION, 1) >= SIDEWAYS else (width, height)
    except TooLarge as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise unreadable(file) from error


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
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
        return cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except TooLarge as error:
        raise unreadable(file, str(error)) from error
    except (OSError, SyntaxError, ValueError, cv2.error):
        return None


def _check_size(content: bytes) -> None:
    """Raise ``TooLarge`` by the head of an image; of JPEG and PNG without Pillow, which takes longer than it needs."""
    if content.startswith(b"\x89PNG\r\n\x1a\n") and len(content) > PNG_SIZE + 8:
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
    if content.startswith(b"\xff\xd8"):  # the last scan does not end; the markers cannot occur within a scan
        return content.rfind(b"\xff\xd9") < content.rfind(b"\xff\xda")
    return content.startswith(b"\x89PNG") and b"IEND" not in content


def unreadable(file: str, why: str = "cannot be read as an image") -> VideoError:
    """The error for an image that cannot be used."""
    return VideoError(f"{file}: {why}; replace it or take it out of the folder")
