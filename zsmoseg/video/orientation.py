"""Images as they are stored: cameras note how one is held (EXIF), and some programs do not turn what they read."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.video import places
from zsmoseg.video.bounds import open_image
from zsmoseg.video.pixels import ORIENTATION, exif, unreadable

UPRIGHT = 1
"""The orientation of what is displayed as it is stored."""


def orientation(file: str) -> int:
    """The EXIF orientation of an image file, 1 to 8.

    Raises
    ------
    VideoError
        If it cannot be read.
    """
    try:
        with open(places.here(file), "rb") as stream, open_image(stream) as image:
            found = exif(image, stream).get(ORIENTATION, UPRIGHT)
    except (OSError, SyntaxError, ValueError) as error:
        raise unreadable(file) from error
    return int(found) if found in range(1, 9) else UPRIGHT


def as_stored(displayed: NDArray[Any], orientation: int) -> NDArray[Any]:
    """What is displayed (H, W) as the file of that orientation has it (CIPA DC-008, Exif 2.32, tag 0x0112)."""
    turned = displayed.T if orientation in (5, 6, 7, 8) else displayed
    up = -1 if orientation in (3, 4, 6, 7) else 1
    left = -1 if orientation in (2, 3, 7, 8) else 1
    return np.ascontiguousarray(turned[::up, ::left])
