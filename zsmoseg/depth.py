"""Pseudo depth without weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings


def inverse_depth(frame: NDArray[np.uint8], s: settings.Depth) -> NDArray[np.float32]:
    """Relative inverse depth of a frame (h, w, 3): (h, w), 1 everywhere with ``source = "constant"``."""
    return np.ones(frame.shape[:2], np.float32)
