"""Pseudo depth without weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings

NEAR = 4.0
"""Inverse depth of the bottom of the frame over that of the top, for ``ground``."""


def inverse_depth(frame: NDArray[np.uint8], s: settings.Depth) -> NDArray[np.float32] | None:
    """Relative inverse depth (h, w) of a frame (h, w, 3); None where it is constant, which says nothing.

    ``ground``: a plane that comes nearer towards the bottom of the frame, as seen by a camera held level.
    """
    if s.source == "constant":
        return None
    height, width = frame.shape[:2]
    ramp = np.linspace(1.0, NEAR, height, dtype=np.float32)
    return np.repeat(ramp[:, None], width, axis=1)
