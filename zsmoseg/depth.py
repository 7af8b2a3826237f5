"""Pseudo depth: a plane without weights; maps from elsewhere brought to the working grid."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

NEAR = 4.0
"""Inverse depth of the bottom of the frame over that of the top, for ``ground``."""


def ground(height: int, width: int) -> NDArray[np.float32]:
    """Relative inverse depth (h, w) of a plane that comes nearer towards the bottom, seen by a camera held level."""
    ramp = np.linspace(1.0, NEAR, height, dtype=np.float32)
    return np.repeat(ramp[:, None], width, axis=1)


def relative(inverse: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """An inverse depth (H, W) on a grid of another (height, width), of mean magnitude 1; NaN = unknown."""
    grid = cv2.resize(inverse, shape[::-1], interpolation=cv2.INTER_AREA)
    known = np.abs(grid[np.isfinite(grid)])
    scale = float(known.mean()) if known.size else 0.0
    return np.asarray(grid / np.float32(scale) if scale > 0 else grid, np.float32)
