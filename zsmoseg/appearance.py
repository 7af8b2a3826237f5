"""What superpixels of like colour, place and time say about one that does not move enough itself.

Source of the grid: Chen, Paris, Durand, "Real-time edge-aware image processing with the bilateral grid",
SIGGRAPH 2007.
"""

from __future__ import annotations

import numpy as np

from zsmoseg import kernels, settings
from zsmoseg.spacetime import Floats, Window


def vote(w: Window, x: Floats, s: settings.Objects) -> Floats:
    """(nodes) mean of ``x`` (nodes) over the superpixels near in colour, place and time, weighted with size."""
    low, high = np.array([0, -48, -48]), np.array([100, 48, 48])
    place = w.place / w.shape[1] / s.vote_place
    feature = np.column_stack(
        [
            (np.clip(w.colour, low, high) - low) / [s.vote_lightness, s.vote_colour, s.vote_colour],
            place,
            (w.start + w.frame) / s.vote_frames,
        ]
    )
    feature -= np.floor(feature.min(0))
    cells = np.floor(feature.max(0)).astype(np.int64) + 2
    stride = np.append(np.cumprod(cells[:0:-1])[::-1], 1)
    grid = np.zeros((int(np.prod(cells)), 2), np.float32)
    kernels.splat(feature, w.size, x, stride, grid)
    for step, count in zip(stride, cells, strict=True):
        kernels.blur(grid.reshape(-1, count, 2 * step))
    mean = kernels.read_grid(feature, stride, grid)
    return np.asarray(mean[:, 1] / np.maximum(mean[:, 0], 1e-9))
