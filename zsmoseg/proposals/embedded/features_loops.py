"""The passes over the pixels behind ``features``, compiled, and the columns that they fill."""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints, Segments, Singles

SIZE, Y, X, L, A, B, RIM, DETAIL, XX, XY, YY = range(11)
"""Columns of ``SuperpixelFeatures.feature``."""
FEATURES = 11
U, V, ERROR, CHANGE = range(4)
"""Columns of ``SuperpixelFeatures.forward`` and ``backward``."""
FLOW_FEATURES = 4
RIM_WIDTH = 2
"""Pixels this close to the border of the frame are its rim: a superpixel beside it may not quite reach it, px."""

Numbers = NDArray[np.int32]


@nb.njit(cache=True)
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


@nb.njit(cache=True)
def boundary_steps(segment: Segments, valid: Bools) -> tuple[Numbers, Numbers]:
    """Both sides, the smaller number first, of every step from a pixel across a boundary of superpixels.

    Parameters
    ----------
    segment, valid
        (h, w) superpixels, and pixels that count.

    Returns
    -------
    first, second
        (n) each.
    """
    height, width = segment.shape
    first, second = np.empty(2 * height * width, np.int32), np.empty(2 * height * width, np.int32)
    n = 0
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            k = np.int64(segment[y, x])
            if x + 1 < width and valid[y, x + 1] and segment[y, x + 1] != k:
                first[n], second[n] = min(k, segment[y, x + 1]), max(k, segment[y, x + 1])
                n += 1
            if y + 1 < height and valid[y + 1, x] and segment[y + 1, x] != k:
                first[n], second[n] = min(k, segment[y + 1, x]), max(k, segment[y + 1, x])
                n += 1
    return first[:n], second[:n]


@nb.njit(cache=True)
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
        (2, h, w) from this frame to the other one, and from there to this one, px.
    detail, other_detail
        (h, w) of this frame and of the other one.
    valid
        (h, w) pixels that count.

    Returns
    -------
    (count, 4): columns ``U`` to ``CHANGE``; 0 where no pixel counts.
    """
    height, width = segment.shape
    out, pixels = np.zeros((count, FLOW_FEATURES), np.float64), np.zeros(count, np.float64)
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            k, u, v = np.int64(segment[y, x]), flow[0, y, x], flow[1, y, x]
            to_x = min(max(int(np.rint(x + u)), 0), width - 1)
            to_y = min(max(int(np.rint(y + v)), 0), height - 1)
            out[k, U] += u
            out[k, V] += v
            out[k, ERROR] += np.sqrt((u + reverse[0, to_y, to_x]) ** 2 + (v + reverse[1, to_y, to_x]) ** 2)
            out[k, CHANGE] += (detail[y, x] - _bilinear(other_detail, x + u, y + v)) ** 2
            pixels[k] += 1
    for i in range(count):
        for j in range(FLOW_FEATURES):
            out[i, j] /= max(pixels[i], 1)
    return out


@nb.njit(cache=True)
def _bilinear(image: Singles, x: float, y: float) -> float:
    """The image (h, w) between its pixels; outside, the nearest on the border."""
    height, width = image.shape
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    i, j = min(int(y), height - 2), min(int(x), width - 2)
    fy, fx = y - i, x - j
    above = image[i, j] * (1 - fx) + image[i, j + 1] * fx
    below = image[i + 1, j] * (1 - fx) + image[i + 1, j + 1] * fx
    return float(above * (1 - fy) + below * fy)


@nb.njit(cache=True)
def carried_runs(
    segment: Segments, other: Segments, flow: Singles, valid: Bools
) -> tuple[Numbers, Numbers, Numbers]:
    """What the flow carries from superpixel to superpixel, in runs of pixels in a row, for they mostly go together.

    Parameters
    ----------
    segment, other
        (h, w) superpixels of this frame, and of the one that ``flow`` (2, h, w) leads to, px.
    valid
        (h, w) pixels that count.

    Returns
    -------
    first, second, run
        (n) each: superpixel here, superpixel there, pixels.
    """
    height, width = segment.shape
    first, second = np.empty(height * width, np.int32), np.empty(height * width, np.int32)
    run = np.empty(height * width, np.int32)
    n = 0
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            to_x, to_y = int(np.rint(x + flow[0, y, x])), int(np.rint(y + flow[1, y, x]))
            if 0 <= to_x < width and 0 <= to_y < height and valid[to_y, to_x]:
                k = np.int64(segment[y, x])
                if n and first[n - 1] == k and second[n - 1] == other[to_y, to_x]:
                    run[n - 1] += 1
                else:
                    first[n], second[n], run[n] = k, other[to_y, to_x], 1
                    n += 1
    return first[:n], second[:n], run[:n]


@nb.njit(cache=True)
def count_pairs(first: Numbers, second: Numbers, run: Numbers, count: int, others: int) -> tuple[Ints, Ints]:
    """The different pairs, and how often each comes.

    A bucket for each ``first``; in it insertion sort, for a superpixel has few partners. A general sort of all
    runs takes several times as long.

    Parameters
    ----------
    first, second, run
        (n) numbers below ``count`` and below ``others``, and how often that pair comes here.

    Returns
    -------
    pairs, times
        (m, 2) in ascending order, and (m).
    """
    start, grouped, length = _grouped(first, second, run, count)
    pairs, times = np.empty((len(first), 2), np.int64), np.empty(len(first), np.int64)
    seen, found = np.zeros(others, np.int64), np.empty(others, np.int64)
    n = 0
    for i in range(count):
        m = 0
        for k in range(start[i], start[i + 1]):
            j = grouped[k]
            if seen[j] == 0:
                h = m
                while h > 0 and found[h - 1] > j:
                    found[h] = found[h - 1]
                    h -= 1
                found[h] = j
                m += 1
            seen[j] += length[k]
        for h in range(m):
            j = found[h]
            pairs[n, 0], pairs[n, 1], times[n] = i, j, seen[j]
            seen[j] = 0
            n += 1
    return pairs[:n], times[:n]


@nb.njit(cache=True)
def _grouped(first: Numbers, second: Numbers, run: Numbers, count: int) -> tuple[Ints, Numbers, Numbers]:
    """``second`` and ``run`` by ascending ``first``, and where (count + 1) each number of ``first`` begins."""
    start = np.zeros(count + 1, np.int64)
    for k in first:
        start[k + 1] += 1
    start = np.cumsum(start)
    place = start[:-1].copy()
    grouped, length = np.empty(len(first), np.int32), np.empty(len(first), np.int32)
    for k in range(len(first)):
        to = place[first[k]]
        grouped[to], length[to] = second[k], run[k]
        place[first[k]] += 1
    return start, grouped, length
