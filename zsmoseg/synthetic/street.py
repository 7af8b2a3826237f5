"""A street: a camera that stands still, and things that cross its view one after the other, for as long as one likes."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE, EVERY, SPEED = 12, 20, 2
"""px of a thing; frames from one to the next; px a frame."""
KINDS = 8
"""Different things, which come again and again."""


def street(
    frames: int, height: int = 48, width: int = 64
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint16]]]:
    """Frame by frame the picture (height, width, 3), and the thing of every pixel, 1 upwards, 0 = none.

    Every other one goes from right to left. The number of things grows with the number of frames, that of the things in
    view does not.
    """
    rng = np.random.default_rng(0)
    wall = _texture(rng, height, width, (40, 120))
    things = [_texture(rng, SIDE, SIDE, (130, 250)) for _ in range(KINDS)]
    rows = rng.integers(2, height - SIDE - 2, frames // EVERY + 1)
    crossing = (width + SIDE) // SPEED
    for t in range(frames):
        frame, thing = wall.copy(), np.zeros((height, width), np.uint16)
        for k in range(max(0, (t - crossing) // EVERY), t // EVERY + 1):
            x = SPEED * (t - k * EVERY) - SIDE
            x = x if k % 2 == 0 else width - SIDE - x
            left, right, y = max(x, 0), min(x + SIDE, width), rows[k]
            if left < right:
                frame[y : y + SIDE, left:right] = things[k % KINDS][:, left - x : right - x]
                thing[y : y + SIDE, left:right] = k + 1
        yield frame, thing


def _texture(
    rng: np.random.Generator, height: int, width: int, between: tuple[int, int]
) -> NDArray[np.uint8]:
    noise = cv2.GaussianBlur(rng.normal(size=(height, width, 3)), (0, 0), 1.0)
    low, high = between
    return np.asarray(np.clip((low + high) / 2 + (high - low) / 4 * noise / noise.std(), 0, 255), np.uint8)
