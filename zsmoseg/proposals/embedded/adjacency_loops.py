"""Which superpixels touch, and which the flow links: passes over the pixels, compiled."""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Bools, Ints, Segments, Singles

Numbers = NDArray[np.int32]


@compiled
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


@compiled
def carried_runs(
    segment: Segments, other: Segments, flow: Singles, valid: Bools
) -> tuple[Numbers, Numbers, Numbers]:
    """What the flow carries from superpixel to superpixel, in runs of pixels in a row, for they mostly go together.

    Parameters
    ----------
    segment, other
        (h, w) superpixels of this frame, and of the one that ``flow`` (2, h, w) leads to, px; NaN leads nowhere.
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
            if not valid[y, x] or np.isnan(flow[0, y, x]) or np.isnan(flow[1, y, x]):
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


@compiled
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


@compiled
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
