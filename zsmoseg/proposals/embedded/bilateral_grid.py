"""What superpixels of like colour, place and time say about one that does not move enough itself.

Source: Chen, Paris, Durand, "Real-time edge-aware image processing with the bilateral grid", SIGGRAPH 2007: a filter
in colour and place is a blur of a coarse grid over both.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Floats, Ints, Singles
from zsmoseg.proposals.embedded.graph import Graph

LOWEST, HIGHEST = np.array([0, -48, -48]), np.array([100, 48, 48])
"""Colours (L, a, b) that have cells of their own; few are stronger, and the grid is held in memory."""
LEAST = 1e-9
"""Smallest weight that is divided by, px."""


@dataclass(frozen=True)
class BilateralGrid:
    """The cells of the grid."""

    vote_lightness: float
    """Side in L, Lab."""
    vote_colour: float
    """Side in a and b, Lab."""
    vote_place: float
    """Side in x and y, share of the frame's width."""
    vote_frames: float
    """Side in time, frames."""


def smooth(graph: Graph, x: Floats, cells: BilateralGrid) -> Floats:
    """(superpixels) mean of ``x`` (superpixels) over those near in colour, place and time, weighted with size."""
    colour = np.clip(graph.colour, LOWEST, HIGHEST) - LOWEST
    point = np.column_stack(
        [
            colour / [cells.vote_lightness, cells.vote_colour, cells.vote_colour],
            graph.place / graph.shape[1] / cells.vote_place,
            (graph.start + graph.frame) / cells.vote_frames,
        ]
    )
    point -= np.floor(point.min(0))
    count = np.floor(point.max(0)).astype(np.int64) + 2
    stride = np.append(np.cumprod(count[:0:-1])[::-1], 1)
    grid = np.zeros((int(np.prod(count)), 2), np.float32)
    splat(point, graph.size, x, stride, grid)
    for step, number in zip(stride, count, strict=True):
        blur(grid.reshape(-1, number, 2 * step))
    mean = slice_grid(point, stride, grid)
    return np.asarray(mean[:, 1] / np.maximum(mean[:, 0], LEAST))


@compiled
def _corners(point: Floats, stride: Ints, share: Floats, cell: Ints) -> None:
    """Fill the weight and the cell of each of the 2^d cells around a point (d)."""
    share[0], cell[0], known = 1.0, 0, 1
    for d in range(len(point)):
        base = int(point[d])
        rest = point[d] - base
        for k in range(known):
            share[known + k], cell[known + k] = share[k] * rest, cell[k] + (base + 1) * stride[d]
            share[k], cell[k] = share[k] * (1 - rest), cell[k] + base * stride[d]
        known *= 2


@compiled
def splat(point: Floats, weight: Floats, x: Floats, stride: Ints, grid: Singles) -> None:
    """Spread values over the cells around their points.

    Parameters
    ----------
    point
        (n, d) in cells, 0 or more.
    weight, x
        (n).
    stride
        (d) distance of neighbouring cells in ``grid``.
    grid
        (cells, 2): weight, and weight times x, are added.
    """
    share, cell = np.empty(1 << point.shape[1]), np.empty(1 << point.shape[1], np.int64)
    for i in range(len(point)):
        _corners(point[i], stride, share, cell)
        for k in range(len(share)):
            grid[cell[k], 0] += weight[i] * share[k]
            grid[cell[k], 1] += weight[i] * share[k] * x[i]


@compiled
def slice_grid(point: Floats, stride: Ints, grid: Singles) -> Floats:
    """(n, 2) the grid at points between its cells, linear; parameters as in ``splat``."""
    out = np.zeros((len(point), 2))
    share, cell = np.empty(1 << point.shape[1]), np.empty(1 << point.shape[1], np.int64)
    for i in range(len(point)):
        _corners(point[i], stride, share, cell)
        for k in range(len(share)):
            out[i, 0] += share[k] * grid[cell[k], 0]
            out[i, 1] += share[k] * grid[cell[k], 1]
    return out


@compiled
def blur(grid: Singles) -> None:
    """Blur by 1-2-1 along the middle axis of (before, n, after), in place; nothing lies outside."""
    last = np.empty(grid.shape[2], grid.dtype)
    for i in range(grid.shape[0]):
        last[:] = 0
        for j in range(grid.shape[1]):
            for k in range(grid.shape[2]):
                here = grid[i, j, k]
                after = grid[i, j + 1, k] if j + 1 < grid.shape[1] else grid.dtype.type(0)
                grid[i, j, k] = (last[k] + here + here + after) / 4
                last[k] = here
