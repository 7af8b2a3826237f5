"""Pixels that count for nothing."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.video.pixels import pixels


def read_ignore(path: str, height: int, width: int) -> NDArray[np.bool_]:
    """(height, width) true where the image ``path`` is not zero, resized to the nearest.

    Raises
    ------
    SettingsError
        If it cannot be read.
    """
    try:
        image = pixels(path)
    except VideoError:
        image = None
    if image is None:
        raise SettingsError(f"{path}: the ignore mask cannot be read as an image; give a PNG to --ignore")
    mask = (image != 0).any(axis=2).astype(np.uint8)
    return np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0)
