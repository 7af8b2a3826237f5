"""Superpixels of one frame: small connected regions of one colour on a nearly regular grid.

Source: Achanta, Shaji, Smith, Lucchi, Fua, Süsstrunk, "SLIC superpixels compared to state-of-the-art superpixel
methods", PAMI 2012; here a pixel looks only at the centres of the 3 x 3 grid cells around its own.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.compiling import compiled
from zsmoseg.errors import SettingsError
from zsmoseg.proposals.embedded.aliases import Floats, Frames, Segments, Singles

MOST = 65535
"""Most superpixels that a frame can have: they are stored in 16 bits."""
FRAGMENT = 4
"""Pieces smaller than the mean superpixel over this are no superpixels; SLIC's authors advise it."""

COUNT = 5
"""Numbers of a cluster: y, x, L, a, b; of sums the next one counts the pixels."""

Clusters = NDArray[np.int32]


@dataclass(frozen=True)
class Superpixels:
    """Parameters of SLIC."""

    pitch: float
    """Distance of the centres, px."""
    compactness: float
    """Weight of place against colour: the distance in Lab that one ``pitch`` counts as."""
    passes: int
    """Passes over the frame, each followed by a move of the centres."""


def segment(frame: Frames, superpixels: Superpixels) -> Segments:
    """Superpixels of one frame.

    Parameters
    ----------
    frame
        (h, w, 3), blue green red.
    superpixels
        Their distance and shape.

    Returns
    -------
    (h, w): the superpixel of each pixel, 0 to n - 1, every one connected and not empty.

    Raises
    ------
    SettingsError
        The frame would have more than 65535 superpixels.
    """
    height, width = frame.shape[:2]
    pitch = superpixels.pitch
    if round(height / pitch) * round(width / pitch) > MOST // 2:
        raise SettingsError(
            f"segments.pitch = {pitch:g}: too many superpixels in {width} x {height} px; "
            f"use {np.sqrt(2 * height * width / MOST):.1f} or more"
        )
    cluster = cluster_pixels(lab(frame), pitch, superpixels.compactness, superpixels.passes)
    connected = connect(cluster, height * width // (FRAGMENT * (int(cluster.max()) + 1)))
    return np.asarray(connected, np.uint16)


def lab(frame: Frames) -> Singles:
    """CIE Lab (L 0 to 100) of a frame (h, w, 3), blurred by 3 x 3 px."""
    colour = cv2.cvtColor(frame.astype(np.float32) / np.float32(255), cv2.COLOR_BGR2LAB)
    return np.asarray(cv2.GaussianBlur(colour, (3, 3), 0), np.float32)


@compiled
def cluster_pixels(lab: Singles, pitch: float, compactness: float, passes: int) -> Clusters:
    """The local k-means of SLIC in colour and place.

    Parameters
    ----------
    lab
        (h, w, 3) L, a, b.
    pitch, compactness, passes
        As in ``Superpixels``.

    Returns
    -------
    (h, w): cluster of each pixel. Clusters may be empty or in several pieces.
    """
    height, width, _ = lab.shape
    rows, columns = max(1, round(height / pitch)), max(1, round(width / pitch))
    step_y, step_x = height / rows, width / columns
    centre = np.zeros((rows * columns, COUNT), np.float32)
    for i in range(rows):
        for j in range(columns):
            y, x = int((i + 0.5) * step_y), int((j + 0.5) * step_x)
            centre[i * columns + j, 0] = y
            centre[i * columns + j, 1] = x
            centre[i * columns + j, 2:] = lab[y, x]
    cluster = np.zeros((height, width), np.int32)
    place = np.float32(compactness * compactness / (step_y * step_x))
    sums = np.zeros((rows * columns, COUNT + 1), np.float64)
    for _ in range(passes):
        sums[:] = 0
        for y in range(height):
            for x in range(width):
                k = _nearest(lab, centre, y, x, int(y / step_y), int(x / step_x), rows, columns, place)
                cluster[y, x] = k
                _add(sums[k], lab, y, x)
        for k in range(rows * columns):
            if sums[k, COUNT] > 0:
                for c in range(COUNT):
                    centre[k, c] = sums[k, c] / sums[k, COUNT]
    return cluster


@compiled
def _add(sums: Floats, lab: Singles, y: int, x: int) -> None:
    """Add place, colour and number of one pixel to the sums (6) of its cluster."""
    sums[0] += y
    sums[1] += x
    sums[2] += lab[y, x, 0]
    sums[3] += lab[y, x, 1]
    sums[4] += lab[y, x, 2]
    sums[COUNT] += 1


@compiled
def _nearest(
    lab: Singles, centre: Singles, y: int, x: int, i: int, j: int, rows: int, columns: int, place: np.float32
) -> int:
    """The nearest centre of the 3 x 3 grid cells around cell (i, j), in which pixel (y, x) lies."""
    c0, c1, c2 = lab[y, x, 0], lab[y, x, 1], lab[y, x, 2]
    best, nearest = np.float32(np.inf), 0
    for row in range(max(0, i - 1), min(rows, i + 2)):
        first = row * columns
        for k in range(first + max(0, j - 1), first + min(columns, j + 2)):
            dy, dx = np.float32(y) - centre[k, 0], np.float32(x) - centre[k, 1]
            d0, d1, d2 = c0 - centre[k, 2], c1 - centre[k, 3], c2 - centre[k, 4]
            d = d0 * d0 + d1 * d1 + d2 * d2 + place * (dy * dy + dx * dx)
            if d < best:
                best, nearest = d, k
    return nearest


@compiled
def connect(cluster: Clusters, smallest: int) -> Clusters:
    """A number for each connected piece; small ones join the superpixel on their left or above.

    Parameters
    ----------
    cluster
        (h, w) as ``cluster_pixels`` gives it.
    smallest
        Pieces with fewer px join; the first one of the frame has nothing to join and stays.

    Returns
    -------
    (h, w): 0 to n - 1 in the order of their first pixels.
    """
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
        size = _flood(cluster, start, count, out, queue)
        if size < smallest and neighbour >= 0:
            for i in range(size):
                out[queue[i] // width, queue[i] % width] = neighbour
        else:
            count += 1
    return out


@compiled
def _flood(cluster: Clusters, start: int, number: int, out: Clusters, queue: Clusters) -> int:
    """Give ``number`` to the piece of pixel ``start``: breadth first, 4 neighbours; its size, its pixels in ``queue``."""
    height, width = cluster.shape
    kind = cluster[start // width, start % width]
    out[start // width, start % width] = number
    queue[0] = start
    head, tail = 0, 1
    while head < tail:
        y, x = queue[head] // width, queue[head] % width
        head += 1
        for k in range(4):
            v, u = y + (k == 0) - (k == 1), x + (k == 2) - (k == 3)
            inside = 0 <= v < height and 0 <= u < width
            if inside and out[v, u] < 0 and cluster[v, u] == kind:
                out[v, u] = number
                queue[tail] = v * width + u
                tail += 1
    return tail
