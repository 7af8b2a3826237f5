"""Depth from elsewhere, of which only ratios count."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def relative(inverse: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """An inverse depth (H, W) on a grid of another (height, width), of mean magnitude 1; NaN = unknown."""
    largest = np.abs(inverse[np.isfinite(inverse)]).max(initial=0)
    # by a power of two, which rounds nothing: sums of what is near either end of float32 stay within it
    inverse = np.ldexp(inverse, -np.frexp(largest)[1])
    grid = cv2.resize(inverse, shape[::-1], interpolation=cv2.INTER_AREA)
    known = np.abs(grid[np.isfinite(grid)])
    scale = float(known.mean()) if known.size else 0.0
    return np.asarray(grid / np.float32(scale) if scale > 0 else grid, np.float32)
