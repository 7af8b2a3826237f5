"""Optical flow between two frames, and whether two frames are a pair at all.

Source of the flow: Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV 2016, as
implemented in OpenCV.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings

PairState = Literal["ok", "cut", "repeat"]


def between(
    a: NDArray[np.uint8], b: NDArray[np.uint8], s: settings.Flow
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Dense flow from ``a`` to ``b`` and from ``b`` to ``a``.

    Parameters
    ----------
    a, b
        Frames (h, w, 3), blue green red.
    s
        The section ``flow`` of the settings.

    Returns
    -------
    forward, backward
        (2, h, w) each, x then y, in px: the pixel (x, y) of ``a`` is at (x, y) + forward[:, y, x] in ``b``.
    """
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(s.finest_scale)
    dis.setPatchStride(s.stride)
    dis.setGradientDescentIterations(s.descent)
    dis.setVariationalRefinementIterations(s.refinement)
    first, second = (cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in (a, b))
    return _planar(dis.calc(first, second, None)), _planar(dis.calc(second, first, None))


def _planar(flow: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.moveaxis(flow, 2, 0), np.float32)
