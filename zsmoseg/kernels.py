"""The inner loops, compiled by Numba. What they compute is described where they are called."""

# mypy: disable-error-code="untyped-decorator, assignment, operator"
from __future__ import annotations

import heapq
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
def measure_frame(
    segment: Array, count: int, lab: Array, detail: Array, slope: Array, valid: Array
) -> tuple[Array, Array, Array]:
    """Per superpixel what ``ChunkTables.node`` holds, and both sides of every step across a boundary."""
    height, width = segment.shape
    node = np.zeros((count, 11), np.float64)
    first, second = np.empty(2 * height * width, np.int32), np.empty(2 * height * width, np.int32)
    n = 0
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
            node[k, 7] += detail[y, x] * detail[y, x]
            node[k, 8] += slope[0, y, x] * slope[0, y, x]
            node[k, 9] += slope[0, y, x] * slope[1, y, x]
            node[k, 10] += slope[1, y, x] * slope[1, y, x]
            if x + 1 < width and valid[y, x + 1] and segment[y, x + 1] != k:
                first[n], second[n] = min(k, segment[y, x + 1]), max(k, segment[y, x + 1])
                n += 1
            if y + 1 < height and valid[y + 1, x] and segment[y + 1, x] != k:
                first[n], second[n] = min(k, segment[y + 1, x]), max(k, segment[y + 1, x])
                n += 1
    for k in range(count):
        for j in (1, 2, 3, 4, 5, 7, 8, 9, 10):
            node[k, j] /= max(node[k, 0], 1)
    return node, first[:n], second[:n]


@nb.njit(cache=True)
def _between(image: Array, x: float, y: float) -> float:
    """Bilinear; outside, the nearest on the border."""
    height, width = image.shape
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    i, j = min(int(y), height - 2), min(int(x), width - 2)
    fy, fx = y - i, x - j
    above = image[i, j] * (1 - fx) + image[i, j + 1] * fx
    below = image[i + 1, j] * (1 - fx) + image[i + 1, j + 1] * fx
    return float(above * (1 - fy) + below * fy)


@nb.njit(cache=True)
def measure_direction(
    segment: Array,
    count: int,
    other: Array,
    flow: Array,
    reverse: Array,
    detail: Array,
    other_detail: Array,
    valid: Array,
) -> tuple[Array, Array, Array, Array]:
    """Per superpixel what ``ChunkTables.forth`` holds; both ends of runs of carried pixels, and their lengths."""
    height, width = segment.shape
    out, pixels = np.zeros((count, 4), np.float64), np.zeros(count, np.float64)
    first, second = np.empty(height * width, np.int32), np.empty(height * width, np.int32)
    run = np.empty(height * width, np.int32)
    n = 0
    for y in range(height):
        for x in range(width):
            if not valid[y, x]:
                continue
            u, v = flow[0, y, x], flow[1, y, x]
            tx, ty, k = int(np.rint(x + u)), int(np.rint(y + v)), np.int64(segment[y, x])
            cx, cy = min(max(tx, 0), width - 1), min(max(ty, 0), height - 1)
            out[k, 0] += u
            out[k, 1] += v
            out[k, 2] += np.sqrt((u + reverse[0, cy, cx]) ** 2 + (v + reverse[1, cy, cx]) ** 2)
            out[k, 3] += (detail[y, x] - _between(other_detail, x + u, y + v)) ** 2
            pixels[k] += 1
            if tx == cx and ty == cy and valid[ty, tx]:
                if n and first[n - 1] == k and second[n - 1] == other[ty, tx]:
                    run[n - 1] += 1
                else:
                    first[n], second[n], run[n] = k, other[ty, tx], 1
                    n += 1
    for k in range(count):
        for j in range(4):
            out[k, j] /= max(pixels[k], 1)
    return out, first[:n], second[:n], run[:n]


@nb.njit(cache=True)
def count_pairs(first: Array, second: Array, run: Array, count: int, others: int) -> tuple[Array, Array]:
    """The different pairs in order, and the sums of their runs; below ``count`` and below ``others``."""
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
def _corners(point: Array, stride: Array, share: Array, cell: Array) -> None:
    """Weight and cell of each of the 2^d cells around a point."""
    share[0], cell[0], known = 1.0, 0, 1
    for d in range(len(point)):
        base = int(point[d])
        rest = point[d] - base
        for k in range(known):
            share[known + k], cell[known + k] = share[k] * rest, cell[k] + (base + 1) * stride[d]
            share[k], cell[k] = share[k] * (1 - rest), cell[k] + base * stride[d]
        known *= 2


@nb.njit(cache=True)
def splat(feature: Array, weight: Array, x: Array, stride: Array, grid: Array) -> None:
    """Spread weight, and weight times x, over the cells around each point."""
    share, cell = np.empty(1 << feature.shape[1]), np.empty(1 << feature.shape[1], np.int64)
    for i in range(len(feature)):
        _corners(feature[i], stride, share, cell)
        for k in range(len(share)):
            grid[cell[k], 0] += weight[i] * share[k]
            grid[cell[k], 1] += weight[i] * share[k] * x[i]


@nb.njit(cache=True)
def read_grid(feature: Array, stride: Array, grid: Array) -> Array:
    """The grid's two values at each point."""
    out = np.zeros((len(feature), 2))
    share, cell = np.empty(1 << feature.shape[1]), np.empty(1 << feature.shape[1], np.int64)
    for i in range(len(feature)):
        _corners(feature[i], stride, share, cell)
        for k in range(len(share)):
            out[i, 0] += share[k] * grid[cell[k], 0]
            out[i, 1] += share[k] * grid[cell[k], 1]
    return out


@nb.njit(cache=True)
def blur(grid: Array) -> None:
    """1-2-1 along the middle axis of (before, n, after), in place; nothing outside."""
    last = np.empty(grid.shape[2], grid.dtype)
    for i in range(grid.shape[0]):
        last[:] = 0
        for j in range(grid.shape[1]):
            for k in range(grid.shape[2]):
                here = grid[i, j, k]
                after = grid[i, j + 1, k] if j + 1 < grid.shape[1] else grid.dtype.type(0)
                grid[i, j, k] = (last[k] + here + here + after) / 4
                last[k] = here


@nb.njit(cache=True)
def normal_equations(offset: Array, basis: Array, flow: Array, weight: Array) -> tuple[Array, Array]:
    """Of the weighted fit of flow (n, 2) by a basis (n, 6) in each frame: (frames, 6, 6), (frames, 6, 2)."""
    normal, right = np.zeros((len(offset) - 1, 6, 6)), np.zeros((len(offset) - 1, 6, 2))
    for t in range(len(offset) - 1):
        for k in range(offset[t], offset[t + 1]):
            for i in range(6):
                scaled = weight[k] * basis[k, i]
                for j in range(i + 1):
                    normal[t, i, j] += scaled * basis[k, j]
                right[t, i, 0] += scaled * flow[k, 0]
                right[t, i, 1] += scaled * flow[k, 1]
        for i in range(6):
            for j in range(i):
                normal[t, j, i] = normal[t, i, j]
    return normal, right


@nb.njit(cache=True)
def reweigh(offset: Array, basis: Array, flow: Array, weight: Array, factor: Array, least: float) -> Array:
    """Weight over (1 + (r / scale)^2)^2, r the residual of the fit ``factor`` (frames, 6, 2)."""
    residual, out = np.empty(len(weight)), np.empty(len(weight))
    for t in range(len(offset) - 1):
        for k in range(offset[t], offset[t + 1]):
            u, v = flow[k, 0], flow[k, 1]
            for i in range(6):
                u -= basis[k, i] * factor[t, i, 0]
                v -= basis[k, i] * factor[t, i, 1]
            residual[k] = np.sqrt(u * u + v * v)
        a, b = offset[t], offset[t + 1]
        scale = max(1.4826 * _weighted_median(residual[a:b], weight[a:b]), least)
        for k in range(a, b):
            out[k] = weight[k] / (1 + (residual[k] / scale) ** 2) ** 2
    return out


@nb.njit(cache=True)
def _weighted_median(x: Array, weight: Array) -> float:
    """To 1 / 16384 of the largest: a histogram of 128 bins, then one of the bin that holds it."""
    low, width, below, half = 0.0, 0.0, 0.0, 0.0
    for k in range(len(x)):
        width = max(width, x[k])
        half += weight[k] / 2
    if width == 0.0:
        return 0.0
    for _ in range(2):
        count = np.zeros(128)
        for k in range(len(x)):
            place = (x[k] - low) / width * 128
            if 0.0 <= place <= 128.0:
                count[min(int(place), 127)] += weight[k]
        b = 0
        while b < 127 and below + count[b] < half:
            below += count[b]
            b += 1
        low, width = low + b * width / 128, width / 128
    return low + width


@nb.njit(cache=True)
def conjugate_gradients(
    start: Array, index: Array, weight: Array, trust: Array, x: Array, strength: float, goal: float, most: int
) -> Array:
    """Both columns z (n, 2) of (trust + strength (D - W)) z = trust x, W in compressed rows, D its row sums."""
    n, s = len(x), np.float32(strength)
    diagonal, z = np.empty(n, np.float32), x.copy()
    rest, step, image = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    goal0, goal1, rz0, rz1, rr0, rr1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        degree, a0, a1 = np.float32(0), np.float32(0), np.float32(0)
        for k in range(start[i], start[i + 1]):
            degree += weight[k]
            a0 += weight[k] * z[index[k], 0]
            a1 += weight[k] * z[index[k], 1]
        diagonal[i] = trust[i] + s * degree
        t0, t1 = trust[i] * x[i, 0], trust[i] * x[i, 1]
        goal0 += goal * goal * t0 * t0
        goal1 += goal * goal * t1 * t1
        rest[i, 0], rest[i, 1] = t0 - diagonal[i] * z[i, 0] + s * a0, t1 - diagonal[i] * z[i, 1] + s * a1
        step[i, 0], step[i, 1] = rest[i, 0] / diagonal[i], rest[i, 1] / diagonal[i]
        rz0 += rest[i, 0] * step[i, 0]
        rz1 += rest[i, 1] * step[i, 1]
        rr0 += rest[i, 0] ** 2
        rr1 += rest[i, 1] ** 2
    for _ in range(most):
        if rr0 <= goal0 and rr1 <= goal1:
            break
        pap0, pap1 = 0.0, 0.0
        for i in range(n):
            a0, a1 = np.float32(0), np.float32(0)
            for k in range(start[i], start[i + 1]):
                w, j = weight[k], index[k]
                a0 += w * step[j, 0]
                a1 += w * step[j, 1]
            b0, b1 = diagonal[i] * step[i, 0] - s * a0, diagonal[i] * step[i, 1] - s * a1
            image[i, 0], image[i, 1] = b0, b1
            pap0 += step[i, 0] * b0
            pap1 += step[i, 1] * b1
        c0 = np.float32(rz0 / pap0) if pap0 > 0 else np.float32(0)
        c1 = np.float32(rz1 / pap1) if pap1 > 0 else np.float32(0)
        new0, new1, rr0, rr1 = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            z[i, 0] += c0 * step[i, 0]
            z[i, 1] += c1 * step[i, 1]
            r0, r1 = rest[i, 0] - c0 * image[i, 0], rest[i, 1] - c1 * image[i, 1]
            rest[i, 0], rest[i, 1] = r0, r1
            new0 += r0 * r0 / diagonal[i]
            new1 += r1 * r1 / diagonal[i]
            rr0 += r0 * r0
            rr1 += r1 * r1
        h0 = np.float32(new0 / rz0) if rz0 > 0 else np.float32(0)
        h1 = np.float32(new1 / rz1) if rz1 > 0 else np.float32(0)
        rz0, rz1 = new0, new1
        for i in range(n):
            step[i, 0] = rest[i, 0] / diagonal[i] + h0 * step[i, 0]
            step[i, 1] = rest[i, 1] / diagonal[i] + h1 * step[i, 1]
    return z


@nb.njit(cache=True)
def contract(pair: Array, pull: Array, parts: int) -> Array:
    """(parts) part that a part is joined to, itself where none: greedy additive edge contraction.

    The ties of a part are a linked list of their ends (2 tie + side); ``tie_of`` finds the tie of two parts. What is
    out of date in the queue is skipped: its tie has another value or other ends, -1 where it is gone.
    """
    value, end, into = pull.copy(), pair.copy(), np.arange(parts)
    head, following = np.full(parts, -1), np.full(2 * len(pull), -1)
    degree = np.zeros(parts, np.int64)
    tie_of = {}
    queue = [(0.0, 0, 0, 0)]
    queue.clear()
    for tie in range(len(pull)):
        tie_of[end[tie].min() * parts + end[tie].max()] = tie
        for side in range(2):
            part = end[tie, side]
            following[2 * tie + side], head[part] = head[part], 2 * tie + side
            degree[part] += 1
        if value[tie] > 0:
            queue.append((-value[tie], end[tie].min(), end[tie].max(), tie))
    heapq.heapify(queue)
    while len(queue) > 0:
        cost, p, q, strongest = heapq.heappop(queue)
        if end[strongest].min() != p or end[strongest].max() != q or value[strongest] != -cost:
            continue
        if degree[p] < degree[q]:
            p, q = q, p
        into[q] = p
        end[strongest] = -1
        degree[p] -= 1
        half = head[q]
        while half >= 0:
            after, tie, side = following[half], half // 2, half % 2
            if end[tie, 0] >= 0:
                r = end[tie, 1 - side]
                key = min(p, r) * parts + max(p, r)
                if key in tie_of:
                    kept = tie_of[key]
                    value[kept] += value[tie]
                    end[tie] = -1
                    degree[r] -= 1
                else:
                    kept = tie
                    tie_of[key] = tie
                    end[tie, side] = p
                    following[half], head[p] = head[p], half
                    degree[p] += 1
                if value[kept] > 0:
                    heapq.heappush(queue, (-value[kept], min(p, r), max(p, r), kept))
            half = after
    return into
