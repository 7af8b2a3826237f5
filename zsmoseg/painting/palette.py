"""Masks as palette images, in the colours of DAVIS."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

UInt8 = NDArray[np.uint8]
COMPRESSION = 2
"""zlib level: masks are flat, higher ones take longer and save next to nothing."""


def palette() -> UInt8:
    """The DAVIS palette, (256, 3) red green blue: the bits of the number, dealt to the channels from the top."""
    number = np.arange(256)
    colours = np.zeros((256, 3), np.uint8)
    for bit in range(8):
        for channel in range(3):
            colours[:, channel] |= (((number >> (3 * bit + channel)) & 1) << (7 - bit)).astype(np.uint8)
    return colours


def encode_png(numbers: NDArray[np.integer[Any]]) -> bytes:
    """A mask as PNG: palette up to 255, else 16-bit grey.

    Parameters
    ----------
    numbers : (H, W) integers 0..65535.
    """
    buffer = BytesIO()
    if int(numbers.max(initial=0)) <= 255:
        image = Image.fromarray(numbers.astype(np.uint8))
        image.putpalette(palette().tobytes())
    else:
        image = Image.fromarray(numbers.astype(np.uint16))
    image.save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()
