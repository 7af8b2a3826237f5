"""Dense optical flow between two frames.

Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV 2016, as implemented in OpenCV.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow
from zsmoseg.flow.search import found_again


@dataclass(frozen=True)
class Dis:
    """Parameters of dense inverse search."""

    finest_scale: int
    """Finest level of the pyramid; 0 = the frames themselves, 1 = half of that."""
    stride: int
    """px between patches (8 px wide)."""
    descent: int
    """Gradient descent steps of a patch."""
    refinement: int
    """Variational refinement steps."""
    reach: int
    """px up to which what the flow lost is searched for (``search``); 0 = not at all."""


def between(first: NDArray[np.uint8], second: NDArray[np.uint8], parameters: Dis) -> tuple[Flow, Flow]:
    """Dense flow from ``first`` to ``second`` and from ``second`` to ``first``.

    Parameters
    ----------
    first, second
        Frames (h, w, 3), blue green red.

    Returns
    -------
    forward, backward
        (2, h, w) each, x then y, in px: the pixel (x, y) of ``first`` is at (x, y) + forward[:, y, x] in ``second``.
    """
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(parameters.finest_scale)
    dis.setPatchStride(parameters.stride)
    dis.setGradientDescentIterations(parameters.descent)
    dis.setVariationalRefinementIterations(parameters.refinement)
    one, two = (np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.uint8) for frame in (first, second))
    forward, backward = dis.calc(one, two, None), dis.calc(two, one, None)  # type: ignore[call-overload]
    if parameters.reach:

        def begun(*frames_and_flow: NDArray[Any]) -> NDArray[np.float32]:
            return np.asarray(dis.calc(*(np.ascontiguousarray(x) for x in frames_and_flow)), np.float32)

        forward, backward = found_again(one, two, forward, backward, parameters.reach, begun)
    return _planar(forward), _planar(backward)


def _planar(flow: NDArray[Any]) -> Flow:
    """(2, h, w) of (h, w, 2)."""
    return np.ascontiguousarray(np.moveaxis(flow, 2, 0), np.float32)
