"""Superpixels of one frame: small connected regions of one colour on a nearly regular grid.

Source: Achanta, Shaji, Smith, Lucchi, Fua, Süsstrunk, "SLIC superpixels compared to state-of-the-art superpixel
methods", PAMI 2012; here a pixel looks only at the centres of the 3 x 3 grid cells around its own.
"""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.errors import SettingsError

MOST = 65535
"""Most superpixels that a frame can have: they are stored in 16 bits."""


def segment(frame: NDArray[np.uint8], s: settings.Segments) -> NDArray[np.uint16]:
    """Superpixels of one frame.

    Parameters
    ----------
    frame
        (h, w, 3), blue green red.
    s
        The section ``segments`` of the settings.

    Returns
    -------
    (h, w): the superpixel of each pixel, 0 to n - 1, every one connected and not empty.

    Raises
    ------
    SettingsError
        The frame would have more than 65535 superpixels.
    """
    height, width = frame.shape[:2]
    if round(height / s.pitch) * round(width / s.pitch) > MOST // 2:
        raise SettingsError(
            f"segments.pitch = {s.pitch:g}: too many superpixels in {width} x {height} px; "
            f"use {np.sqrt(2 * height * width / MOST):.1f} or more"
        )
    clusters = _slic(lab(frame), s.pitch, s.compactness, s.passes)
    return _connected(clusters, int(s.pitch * s.pitch / 4)).astype(np.uint16)


def lab(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    """CIE Lab (L 0 to 100) of a frame (h, w, 3), blurred by 3 x 3 px."""
    colour = cv2.cvtColor(frame.astype(np.float32) / np.float32(255), cv2.COLOR_BGR2LAB)
    return cv2.GaussianBlur(colour, (3, 3), 0)


@nb.njit(cache=True)
def _slic(lab, pitch, compactness, passes):  # type: ignore[no-untyped-def]
    """Cluster of each pixel: nearest in colour and place of the centres of its 3 x 3 grid cells."""
    height, width, _ = lab.shape
    rows, columns = max(1, int(round(height / pitch))), max(1, int(round(width / pitch)))
    step_y, step_x = height / rows, width / columns
    centre = np.zeros((rows * columns, 5), np.float32)
    for i in range(rows):
        for j in range(columns):
            y, x = int((i + 0.5) * step_y), int((j + 0.5) * step_x)
            centre[i * columns + j, 0] = y
            centre[i * columns + j, 1] = x
            centre[i * columns + j, 2:] = lab[y, x]
    cluster = np.zeros((height, width), np.int32)
    place = np.float32(compactness * compactness / (step_y * step_x))
    sums = np.zeros((rows * columns, 6), np.float64)
    for _ in range(passes):
        sums[:] = 0
        for y in range(height):
            i = int(y / step_y)
            for x in range(width):
                j = int(x / step_x)
                c0, c1, c2 = lab[y, x, 0], lab[y, x, 1], lab[y, x, 2]
                best, nearest = np.float32(1e18), 0
                for row in range(max(0, i - 1), min(rows, i + 2)):
                    first = row * columns
                    for k in range(first + max(0, j - 1), first + min(columns, j + 2)):
                        dy, dx = np.float32(y) - centre[k, 0], np.float32(x) - centre[k, 1]
                        d0, d1, d2 = c0 - centre[k, 2], c1 - centre[k, 3], c2 - centre[k, 4]
                        d = d0 * d0 + d1 * d1 + d2 * d2 + place * (dy * dy + dx * dx)
                        if d < best:
                            best, nearest = d, k
                cluster[y, x] = nearest
                sums[nearest, 0] += y
                sums[nearest, 1] += x
                sums[nearest, 2] += c0
                sums[nearest, 3] += c1
                sums[nearest, 4] += c2
                sums[nearest, 5] += 1
        for k in range(rows * columns):
            if sums[k, 5] > 0:
                for c in range(5):
                    centre[k, c] = sums[k, c] / sums[k, 5]
    return cluster


@nb.njit(cache=True)
def _connected(cluster, smallest):  # type: ignore[no-untyped-def]
    """A number for each connected piece; pieces below ``smallest`` px join their left or upper neighbour."""
    height, width = cluster.shape
    out = np.full((height, width), -1, np.int32)
    queue = np.empty(height * width, np.int32)
    count = 0
    for start in range(height * width):
        y0, x0 = start // width, start % width
        if out[y0, x0] >= 0:
            continue
        neighbour = -1
        if x0 > 0:
            neighbour = out[y0, x0 - 1]
        elif y0 > 0:
            neighbour = out[y0 - 1, x0]
        out[y0, x0] = count
        queue[0] = start
        head, tail = 0, 1
        while head < tail:
            y, x = queue[head] // width, queue[head] % width
            head += 1
            for k in range(4):
                v, u = y + (k == 0) - (k == 1), x + (k == 2) - (k == 3)
                inside = 0 <= v < height and 0 <= u < width
                if inside and out[v, u] < 0 and cluster[v, u] == cluster[y0, x0]:
                    out[v, u] = count
                    queue[tail] = v * width + u
                    tail += 1
        if tail < smallest and neighbour >= 0:
            for i in range(tail):
                out[queue[i] // width, queue[i] % width] = neighbour
        else:
            count += 1
    return out
