"""From objects to masks: which group or thing every pixel belongs to, palette images, overlays."""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

UInt8 = NDArray[np.uint8]


def paint_table(
    number: NDArray[np.int64], moving: NDArray[np.bool_] | None, when: Literal["ever", "now"]
) -> NDArray[np.uint16]:
    """The look-up table from object to painted number at one frame.

    Parameters
    ----------
    number : (objects,) group or thing of every object, 0 = static, at most 65535.
    moving : (objects,) whether it moves at this frame; needed for ``when = "now"``.
    when : paint a mover wherever it is seen, or only while it moves.
    """
    painted = number if when == "ever" or moving is None else np.where(moving, number, 0)
    return painted.astype(np.uint16)


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
    from io import BytesIO

    buffer = BytesIO()
    if int(numbers.max(initial=0)) <= 255:
        image = Image.fromarray(numbers.astype(np.uint8))
        image.putpalette(palette().tobytes())
    else:
        image = Image.fromarray(numbers.astype(np.uint16))
    image.save(buffer, "PNG", compress_level=2)
    return buffer.getvalue()


def overlay(frame: UInt8, mask: NDArray[np.integer[Any]], strength: float = 0.55) -> UInt8:
    """Colour the groups of ``mask`` (H, W) on ``frame`` (H, W, 3, BGR) and draw their outline.

    The hues go round the circle by the golden angle, so neighbours in number differ; group 1 is orange.
    """
    out = frame.copy()
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return out
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    part, inside = out[box], mask[box].astype(np.uint16)
    on = inside > 0
    colours = group_colours(int(inside.max()))[inside[on]]
    part[on] = cv2.addWeighted(part[on], 1 - strength, colours, strength, 0)
    padded = cv2.copyMakeBorder(inside, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    edge = cv2.morphologyEx(padded, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    part[edge & on] = colours[edge[on]]
    return out


def group_colours(highest: int) -> UInt8:
    """(highest + 1, 3) BGR; number 0 is black."""
    hue = (18 + 68.754 * (np.arange(highest + 1) - 1)) % 180
    hsv = np.stack([hue, np.full_like(hue, 230), np.full_like(hue, 255)], 1).astype(np.uint8)
    colours = cv2.cvtColor(hsv[None], cv2.COLOR_HSV2BGR)[0]
    colours[0] = 0
    return np.asarray(colours, np.uint8)
