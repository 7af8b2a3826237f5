"""Masks for reconstruction (COLMAP, nerfstudio): 255 where a pixel may be used, 0 where something moves."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def encode_keep(moving: NDArray[np.bool_], dilate: int = 0) -> bytes:
    """A grey PNG.

    Parameters
    ----------
    moving : (H, W) pixels to ignore.
    dilate : px by which they grow: all within this distance of one are ignored too.
    """
    ignored = moving.astype(np.uint8)
    if dilate and ignored.any():
        away = cv2.distanceTransform(1 - ignored, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        ignored |= away <= dilate
    return cv2.imencode(".png", np.where(ignored > 0, 0, 255).astype(np.uint8))[1].tobytes()
