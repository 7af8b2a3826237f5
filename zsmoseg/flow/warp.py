"""Images and flow brought to other places: read along flow, resized, inverted.

The inverse of a flow as a fixed point: Chen, Lu, Chen, Ruchala, Olivera, "A simple fixed-point approach to invert a
deformation field", Medical Physics 2008.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow

KNOWN = 0.5
"""Part of the pixels behind one of a coarser grid that must be known for it to be."""
ROUNDS = 8
"""Steps to the fixed point of the inverse flow; each shortens the error by the slope of the flow, which is below 1
where it does not fold."""


def read_at(image: NDArray[Any], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[Any]:
    """An image (H, W) or (H, W, channels) at places (h, w) in px: bilinear, outside the nearest on the border."""
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def resized(flow: Flow, shape: tuple[int, int]) -> Flow:
    """A flow (2, H, W) on a grid of another (height, width), in px of that grid; NaN = unknown.

    A pixel is known where half of what it is the mean of is.
    """
    if flow.shape[1:] == shape:
        return flow
    scale = np.array([shape[1] / flow.shape[2], shape[0] / flow.shape[1]], np.float32)[:, None, None]
    known = np.asarray(np.isfinite(flow).all(axis=0))

    def shrunk(x: NDArray[Any]) -> Flow:
        return np.asarray(cv2.resize(x, shape[::-1], interpolation=cv2.INTER_AREA), np.float32)

    part = shrunk(known.astype(np.float32))
    sums = np.stack([shrunk(np.asarray(np.nan_to_num(axis) * known)) for axis in flow])
    mean = sums * scale / np.maximum(part, np.float32(KNOWN))
    return np.asarray(np.where(part >= KNOWN, mean, np.nan), np.float32)


def inverted(forward: Flow) -> Flow:
    """The flow backward, from the flow forward (2, h, w): the fixed point of b(p) = -f(p + b(p)).

    Where the flow folds, one of the pixels that come to a place is taken.
    """
    y, x = np.mgrid[: forward.shape[1], : forward.shape[2]].astype(np.float32)
    backward = -forward
    for _ in range(ROUNDS):
        u, v = np.nan_to_num(backward)
        backward = -np.stack([read_at(f, x + u, y + v) for f in forward])
    return np.asarray(backward, np.float32)
