"""A guess at depth without weights: the ground before a camera that is held level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NEAR = 4.0
"""Inverse depth of the bottom of the frame over that of the top: as of a street seen from a walker's height."""


def ground(height: int, width: int) -> NDArray[np.float32]:
    """Relative inverse depth (height, width) of a plane that comes nearer towards the bottom."""
    ramp = np.linspace(1.0, NEAR, height, dtype=np.float32)
    return np.repeat(ramp[:, None], width, axis=1)
