"""The inner loops, compiled by Numba. What they compute is described where they are called."""

# mypy: disable-error-code="untyped-decorator, assignment, operator"
from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@nb.njit(cache=True)
def slic(lab: Array, pitch: float, compactness: float, passes: int) -> Array:
    """Cluster of each pixel: nearest in colour and place of the centres of its 3 x 3 grid cells."""
    height, width, _ = lab.shape
    rows, columns = max(1, round(height / pitch)), max(1, round(width / pitch))
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
def connected(cluster: Array, smallest: int) -> Array:
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


@nb.njit(cache=True)
def measure_frame(segment: Array, count: int, lab: Array, valid: Array) -> tuple[Array, Array]:
    """Per superpixel what ``ChunkTables.node`` holds, and the key of every step across a boundary."""
    height, width = segment.shape
    node = np.zeros((count, 7), np.float64)
    keys, n = np.empty(2 * height * width, np.int64), 0
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            k = np.int64(segment[y, x])
            node[k, 0] += 1
            node[k, 1] += y
            node[k, 2] += x
            node[k, 3] += lab[y, x, 0]
            node[k, 4] += lab[y, x, 1]
            node[k, 5] += lab[y, x, 2]
            if y < 2 or x < 2 or y >= height - 2 or x >= width - 2:
                node[k, 6] += 1
            if x + 1 < width and valid[y, x + 1] and segment[y, x + 1] != k:
                other = np.int64(segment[y, x + 1])
                keys[n] = min(k, other) * count + max(k, other)
                n += 1
            if y + 1 < height and valid[y + 1, x] and segment[y + 1, x] != k:
                other = np.int64(segment[y + 1, x])
                keys[n] = min(k, other) * count + max(k, other)
                n += 1
    for k in range(count):
        for j in range(1, 6):
            node[k, j] /= max(node[k, 0], 1)
    return node, keys[:n]


@nb.njit(cache=True)
def measure_direction(
    segment: Array, count: int, other: Array, flow: Array, reverse: Array, camera: Array, valid: Array
) -> tuple[Array, Array]:
    """Per superpixel what ``ChunkTables.forth`` holds, and the key of the link of every carried pixel."""
    height, width = segment.shape
    others = np.int64(other.max()) + 1
    out, pixels = np.zeros((count, 4), np.float64), np.zeros(count, np.float64)
    keys, n = np.empty(height * width, np.int64), 0
    for y in range(height):
        yn = (y - height / 2) / (width / 2)
        for x in range(width):
            if not valid[y, x]:
                continue
            xn = (x - width / 2) / (width / 2)
            u, v = flow[0, y, x], flow[1, y, x]
            c = camera
            ru = u - (
                c[0, 0]
                + c[1, 0] * xn
                + c[2, 0] * yn
                + c[3, 0] * xn * xn
                + c[4, 0] * xn * yn
                + c[5, 0] * yn * yn
            )
            rv = v - (
                c[0, 1]
                + c[1, 1] * xn
                + c[2, 1] * yn
                + c[3, 1] * xn * xn
                + c[4, 1] * xn * yn
                + c[5, 1] * yn * yn
            )
            tx, ty, k = int(np.rint(x + u)), int(np.rint(y + v)), segment[y, x]
            cx, cy = min(max(tx, 0), width - 1), min(max(ty, 0), height - 1)
            out[k, 0] += u
            out[k, 1] += v
            out[k, 2] += np.sqrt(ru * ru + rv * rv)
            out[k, 3] += np.sqrt((u + reverse[0, cy, cx]) ** 2 + (v + reverse[1, cy, cx]) ** 2)
            pixels[k] += 1
            if tx == cx and ty == cy and valid[ty, tx]:
                keys[n] = np.int64(k) * others + other[ty, tx]
                n += 1
    for k in range(count):
        for j in range(4):
            out[k, j] /= max(pixels[k], 1)
    return out, keys[:n]


@nb.njit(cache=True)
def _corner(feature: Array, i: int, corner: int, stride: Array) -> tuple[float, int]:
    """Weight and cell of one of the 2^d cells around a point."""
    share, cell = 1.0, 0
    for d in range(feature.shape[1]):
        base, up = int(feature[i, d]), (corner >> d) & 1
        rest = feature[i, d] - base
        share *= rest if up else 1 - rest
        cell += (base + up) * stride[d]
    return share, cell


@nb.njit(cache=True)
def splat(feature: Array, weight: Array, x: Array, stride: Array, grid: Array) -> None:
    """Spread weight, and weight times x, over the cells around each point."""
    for i in range(len(feature)):
        for corner in range(1 << feature.shape[1]):
            share, cell = _corner(feature, i, corner, stride)
            if share > 0:
                grid[cell, 0] += weight[i] * share
                grid[cell, 1] += weight[i] * share * x[i]


@nb.njit(cache=True)
def read_grid(feature: Array, stride: Array, grid: Array) -> Array:
    """The grid's two values at each point."""
    out = np.zeros((len(feature), 2))
    for i in range(len(feature)):
        for corner in range(1 << feature.shape[1]):
            share, cell = _corner(feature, i, corner, stride)
            if share > 0:
                out[i, 0] += share * grid[cell, 0]
                out[i, 1] += share * grid[cell, 1]
    return out


@nb.njit(cache=True)
def gram_matrices(slot: Array, x: Array, y: Array, q: Array, u: Array, v: Array, count: int) -> Array:
    """Sums of products per slot; a pixel with slot below 0 or values that are not finite is left out."""
    height, width = slot.shape
    gram = np.zeros((count, 11, 11))
    psi = np.empty(11)
    for r in range(height):
        for c in range(width):
            n = slot[r, c]
            value = q[r, c] + u[r, c] + v[r, c]
            if n < 0 or not np.isfinite(value):
                continue
            psi[0], psi[1], psi[2], psi[3] = 1.0, x[c], y[r], q[r, c]
            psi[4], psi[5] = x[c] * q[r, c], y[r] * q[r, c]
            psi[6], psi[7], psi[8] = x[c] * x[c], x[c] * y[r], y[r] * y[r]
            psi[9], psi[10] = u[r, c], v[r, c]
            for i in range(11):
                for j in range(i, 11):
                    gram[n, i, j] += psi[i] * psi[j]
    for n in range(count):
        for i in range(11):
            for j in range(i):
                gram[n, i, j] = gram[n, j, i]
    return gram


@nb.njit(cache=True)
def measure_pieces_of(slot: Array, lab: Array, colour: Array) -> tuple[Array, Array]:
    """Area and box per slot; colours are added to ``colour``. The background has no colour and no box."""
    height, width = slot.shape
    count = len(colour)
    area = np.zeros(count, np.int32)
    box = np.full((count, 4), np.nan, np.float32)
    for y in range(height):
        for x in range(width):
            n = slot[y, x]
            area[n] += 1
            if n == 0:
                continue
            code = np.int64(lab[y, x, 0]) * 8 // 256
            for c in range(1, 3):
                part = (np.int64(lab[y, x, c]) - 80) // 16
                code = code * 6 + min(max(part, 0), 5)
            colour[n, code] += 1
            if np.isnan(box[n, 0]):
                box[n, 0], box[n, 1], box[n, 2], box[n, 3] = x, y, x + 1, y + 1
            else:
                box[n, 0], box[n, 2] = min(box[n, 0], x), max(box[n, 2], x + 1)
                box[n, 3] = y + 1
    return area, box
