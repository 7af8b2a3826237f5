"""Groups in colour on the frames."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

UInt8 = NDArray[np.uint8]
STRENGTH = 0.55
"""Part of the colour in what is painted: strong enough to see, weak enough to see through."""
FIRST_HUE, GOLDEN_ANGLE = 18, 68.754
"""Hue of group 1, orange, and from one group to the next, in the half degrees of OpenCV."""
HUES, SATURATION, VALUE = 180, 230, 255
LONGEST = 2**14
"""Pixels of a side that x264 encodes."""


def overlay(frame: UInt8, mask: NDArray[np.integer[Any]]) -> UInt8:
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
    part[on] = cv2.addWeighted(part[on], 1 - STRENGTH, colours, STRENGTH, 0)
    padded = cv2.copyMakeBorder(inside, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    edge = cv2.morphologyEx(padded, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    part[edge & on] = colours[edge[on]]
    return out


def encoded_size(height: int, width: int) -> tuple[int, int]:
    """Height and width that H.264 takes: even, at least 2, at most ``LONGEST``, with the shape kept."""
    scale = min(1.0, LONGEST / max(height, width))
    return max(2, int(height * scale) // 2 * 2), max(2, int(width * scale) // 2 * 2)


def fitted(image: UInt8) -> UInt8:
    """An image (H, W, 3) of its ``encoded_size``: too large ones are scaled down, an odd row or column is left out, a single one
    is doubled.
    """
    height, width = encoded_size(*image.shape[:2])
    if max(image.shape[:2]) > LONGEST:
        return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    more = [(0, max(0, even - side)) for even, side in zip((height, width), image.shape[:2], strict=True)]
    padded = np.pad(image, [*more, (0, 0)], mode="edge") if any(after for _, after in more) else image
    return np.ascontiguousarray(padded[:height, :width])


def group_colours(highest: int) -> UInt8:
    """Colour of every number, (highest + 1, 3) BGR; number 0 is black."""
    hue = (FIRST_HUE + GOLDEN_ANGLE * (np.arange(highest + 1) - 1)) % HUES
    hsv = np.stack([hue, np.full_like(hue, SATURATION), np.full_like(hue, VALUE)], 1).astype(np.uint8)
    colours = cv2.cvtColor(hsv[None], cv2.COLOR_HSV2BGR)[0]
    colours[0] = 0
    return np.asarray(colours, np.uint8)
