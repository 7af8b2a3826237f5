"""How noisy flow is, measured on the flow itself.

Second differences cancel what changes evenly over the picture, which a motion model explains, and keep what changes at
random: of independent errors they have six times the variance. Taken over neighbours: von Neumann, "Distribution of the
ratio of the mean square successive difference to the variance", 1941; of images: Immerkaer, "Fast noise variance
estimation", CVIU 1996. The errors of flow are alike over a window, so they are taken over a distance here.
"""

# mypy: disable-error-code="untyped-decorator, operator"
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.flow.consistency import Flow

GAIN = 6.0
"""Variance of a second difference of independent errors over theirs: 1 + 4 + 1."""


def flow_noise(flow: Flow, used: NDArray[np.bool_], lag: int) -> float:
    """Variance of the error of flow, px^2, both components together; 0 where there is nothing to measure it on.

    Parameters
    ----------
    flow : (2, h, w) px; NaN = unknown.
    used : (h, w) the pixels to measure on, such as those of the background.
    lag : px between the three pixels of a difference, along rows and columns.
    """
    total, count = _second_differences(flow[0], flow[1], used, lag)
    return float(total / (GAIN * count)) if count else 0.0


@compiled
def _second_differences(u: NDArray[Any], v: NDArray[Any], used: NDArray[Any], lag: int) -> tuple[float, int]:
    """Sum of squares of the differences whose three pixels are ``used`` and known, and their number."""
    height, width = used.shape
    total, count = 0.0, 0
    for y in range(height):
        for x in range(width):
            if not used[y, x]:
                continue
            if x >= 2 * lag and used[y, x - lag] and used[y, x - 2 * lag]:
                a = np.float64(u[y, x]) - 2 * np.float64(u[y, x - lag]) + np.float64(u[y, x - 2 * lag])
                b = np.float64(v[y, x]) - 2 * np.float64(v[y, x - lag]) + np.float64(v[y, x - 2 * lag])
                if np.isfinite(a + b):
                    total += a * a + b * b
                    count += 1
            if y >= 2 * lag and used[y - lag, x] and used[y - 2 * lag, x]:
                a = np.float64(u[y, x]) - 2 * np.float64(u[y - lag, x]) + np.float64(u[y - 2 * lag, x])
                b = np.float64(v[y, x]) - 2 * np.float64(v[y - lag, x]) + np.float64(v[y - 2 * lag, x])
                if np.isfinite(a + b):
                    total += a * a + b * b
                    count += 1
    return total, count
