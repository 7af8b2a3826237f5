"""Frames of DAVIS in two shapes, and seed masks, for the scripts that compare trackers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

SIZES = ((240, 427), (301, 200))
"""Height and width, px: frames shrunk, and their middle upright."""


def frames_of(folder: Path, size: tuple[int, int], count: int) -> list[np.ndarray]:
    """(h, w, 3) blue green red, every second frame."""
    found = []
    for path in sorted(folder.glob("*.jpg"))[: 2 * count : 2]:
        image = cv2.imread(str(path))
        assert image is not None
        scale = max(size[0] / image.shape[0], size[1] / image.shape[1])
        whole = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        left = (whole.shape[1] - size[1]) // 2
        found.append(np.ascontiguousarray(whole[: size[0], left : left + size[1]]))
    return found


def seed(size: tuple[int, int], count: int) -> np.ndarray:
    """(h, w) squares on a grid."""
    label = np.zeros(size, np.uint16)
    columns = 3 if count <= 3 else 4
    for n in range(count):
        y, x = (n // columns) * size[0] // 4 + size[0] // 8, (n % columns) * size[1] // columns + 8
        label[y : y + size[0] // 6, x : x + size[1] // 6] = n + 1
    return label
