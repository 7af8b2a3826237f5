"""Means over superpixels, compiled, and the columns that they fill."""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numpy as np

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Bools, Floats, Segments, Singles

COLUMNS = ("size", "y", "x", "L", "a", "b", "rim", "detail", "slope_xx", "slope_xy", "slope_yy")
SIZE, Y, X, L, A, B, RIM, DETAIL, XX, XY, YY = range(len(COLUMNS))
"""Columns of ``SuperpixelFeatures.feature``."""
FEATURES = len(COLUMNS)
FLOW_COLUMNS = ("u", "v", "error", "change")
U, V, ERROR, CHANGE = range(len(FLOW_COLUMNS))
"""Columns of ``SuperpixelFeatures.forward`` and ``backward``."""
FLOW_FEATURES = len(FLOW_COLUMNS)
RIM_WIDTH = 2
"""Pixels this close to the border of the frame are its rim: a superpixel beside it may not quite reach it, px."""


@compiled
def mean_features(
    segment: Segments, count: int, lab: Singles, detail: Singles, slope: Singles, valid: Bools
) -> Floats:
    """Place, colour and texture of every superpixel of one frame.

    Parameters
    ----------
    segment
        (h, w) superpixels 0 to ``count`` - 1.
    lab, detail, slope
        (h, w, 3), (h, w) and (2, h, w) of the frame.
    valid
        (h, w) pixels that count.

    Returns
    -------
    (count, 11): columns ``SIZE`` to ``YY``; 0 where no pixel counts.
    """
    height, width = segment.shape
    out = np.zeros((count, FEATURES), np.float64)
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            row = out[np.int64(segment[y, x])]
            row[SIZE] += 1
            row[Y] += y
            row[X] += x
            row[L] += lab[y, x, 0]
            row[A] += lab[y, x, 1]
            row[B] += lab[y, x, 2]
            if min(y, x, height - 1 - y, width - 1 - x) < RIM_WIDTH:
                row[RIM] += 1
            row[DETAIL] += detail[y, x] * detail[y, x]
            row[XX] += slope[0, y, x] * slope[0, y, x]
            row[XY] += slope[0, y, x] * slope[1, y, x]
            row[YY] += slope[1, y, x] * slope[1, y, x]
    for k in range(count):
        for j in range(FEATURES):
            if j not in (SIZE, RIM):
                out[k, j] /= max(out[k, SIZE], 1)
    return out


@compiled
def mean_flow(
    segment: Segments,
    count: int,
    flow: Singles,
    reverse: Singles,
    detail: Singles,
    other_detail: Singles,
    valid: Bools,
) -> Floats:
    """Flow of every superpixel of a frame, how far it is from closing, and what it leaves unexplained.

    Parameters
    ----------
    segment
        (h, w) superpixels 0 to ``count`` - 1.
    flow, reverse
        (2, h, w) from this frame to the other one, and from there to this one, px; NaN = unknown, which counts for
        nothing.
    detail, other_detail
        (h, w) of this frame and of the other one.
    valid
        (h, w) pixels that count.

    Returns
    -------
    (count, 4): columns ``U`` to ``CHANGE``; 0 where all pixels are ignored, NaN where nothing is known of the others.
    """
    height, width = segment.shape
    out, pixels = np.zeros((count, FLOW_FEATURES), np.float64), np.zeros((count, FLOW_FEATURES), np.float64)
    seen = np.zeros(count, np.bool_)
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            k, u, v = np.int64(segment[y, x]), flow[0, y, x], flow[1, y, x]
            seen[k] = True
            if np.isnan(u) or np.isnan(v):
                continue
            to_x = min(max(int(np.rint(x + u)), 0), width - 1)
            to_y = min(max(int(np.rint(y + v)), 0), height - 1)
            error = np.sqrt((u + reverse[0, to_y, to_x]) ** 2 + (v + reverse[1, to_y, to_x]) ** 2)
            if not np.isnan(error):
                out[k, ERROR] += error
                pixels[k, ERROR] += 1
            out[k, U] += u
            out[k, V] += v
            out[k, CHANGE] += (detail[y, x] - _bilinear(other_detail, x + u, y + v)) ** 2
            for j in (U, V, CHANGE):
                pixels[k, j] += 1
    for i in range(count):
        for j in range(FLOW_FEATURES):
            out[i, j] = np.nan if seen[i] and pixels[i, j] == 0 else out[i, j] / max(pixels[i, j], 1)
    return out


@compiled
def _bilinear(image: Singles, x: float, y: float) -> float:
    """The image (h, w) between its pixels; outside, the nearest on the border."""
    height, width = image.shape
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    i, j = min(int(y), height - 2), min(int(x), width - 2)
    fy, fx = y - i, x - j
    above = image[i, j] * (1 - fx) + image[i, j + 1] * fx
    below = image[i + 1, j] * (1 - fx) + image[i + 1, j + 1] * fx
    return float(above * (1 - fy) + below * fy)
