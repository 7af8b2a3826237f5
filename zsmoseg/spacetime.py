"""The superpixels of many frames as one graph: neighbours in the frame, and links along the flow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from zsmoseg import kernels
from zsmoseg.flow.pairs import REPEAT
from zsmoseg.tables import ChunkTables

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ERROR, CHANGE = 2, 3
"""Columns of ``Window.forth`` and ``Window.back``."""


@dataclass(frozen=True)
class Window:
    """Frames ``start`` to ``start + F - 1`` of a shot; superpixels (nodes) are numbered through all of them."""

    start: int
    shape: tuple[int, int]
    """Height and width of the working grid, px."""
    offset: Ints
    """(F + 1) first node of each frame."""
    frame: Ints
    """(nodes) frame of each node, counted from 0."""
    size: Floats
    """(nodes) px."""
    place: Floats
    """(nodes, 2) y, x in px."""
    colour: Floats
    """(nodes, 3) L, a, b."""
    rim: NDArray[np.bool_]
    """(nodes) whether it touches the border of the frame."""
    detail: Floats
    """(nodes, 4) mean square of the detail, and of its slope: xx, xy, yy."""
    edge_offset: Ints
    """(F + 1) first edge of each frame."""
    edge: Ints
    """(edges, 2) neighbours in a frame."""
    boundary: Floats
    """(edges) length of the common boundary, px."""
    link_offset: Ints
    """(F) first link of each frame to the next."""
    link: Ints
    """(links, 2) nodes of one frame and the next."""
    carried: Floats
    """(links) pixels carried, both ways, each over 1 + error^2."""
    forth: Floats
    """(nodes, 4) as in ``ChunkTables``; where there is none, ``back`` turned around."""
    back: Floats
    """(nodes, 4) the same, towards the frame before."""
    known: NDArray[np.bool_]
    """(F) whether a frame has any flow at all: not so between two repeats."""

    @property
    def frames(self) -> int:
        """F."""
        return len(self.offset) - 1

    @cached_property
    def edge_colour(self) -> Floats:
        """(edges) distance in Lab of the two neighbours."""
        return colour_distance(self, self.edge)

    @cached_property
    def edge_flow(self) -> tuple[Floats, Floats]:
        """(edges) each: distance of the flow of the two neighbours, forth and back, px."""
        i, j = self.edge.T
        forth, back = ((flow[i, :2] - flow[j, :2]).T for flow in (self.forth, self.back))
        return np.hypot(*forth), np.hypot(*back)

    def of(self, frame: int) -> slice:
        """The nodes of a frame."""
        return slice(self.offset[frame], self.offset[frame + 1])


def window(tables: ChunkTables, start: int, shape: tuple[int, int]) -> Window:
    """The graph of consecutive frames.

    Parameters
    ----------
    tables
        Of F frames and F - 1 pairs, none of them a cut.
    start
        Number of the first frame in its shot.
    shape
        Height and width of the working grid, px.
    """
    offset = tables.node_offset
    frames = len(offset) - 1
    frame = np.repeat(np.arange(frames), np.diff(offset))
    node = tables.node.astype(np.float64)
    moved = tables.state != REPEAT
    has_next, has_last = np.r_[moved, False], np.r_[False, moved]
    forth, back = np.zeros((len(node), 4)), np.zeros((len(node), 4))
    forth[: len(tables.forth)] = tables.forth
    back[len(back) - len(tables.back) :] = tables.back
    pair = np.repeat(np.arange(frames - 1), np.diff(tables.link_offset))
    link = tables.link.astype(np.int64) + np.stack([offset[pair], offset[pair + 1]], 1)
    reliable = 1 / (1 + np.stack([forth[link[:, 0], ERROR], back[link[:, 1], ERROR]], 1) ** 2)
    turned = np.array([-1, -1, 1, 1])
    forward, backward = has_next[frame, None], has_last[frame, None]
    edge_frame = np.repeat(np.arange(frames), np.diff(tables.edge_offset))
    return Window(
        start=start,
        shape=shape,
        offset=offset,
        frame=frame,
        size=node[:, 0],
        place=node[:, 1:3],
        colour=node[:, 3:6],
        rim=node[:, 6] > 0,
        detail=node[:, 7:11],
        edge_offset=tables.edge_offset,
        edge=tables.edge.astype(np.int64) + offset[edge_frame, None],
        boundary=tables.boundary.astype(np.float64),
        link_offset=tables.link_offset,
        link=link,
        carried=(tables.carried * reliable).sum(1),
        forth=np.where(forward, forth, np.where(backward, turned * back, 0)),
        back=np.where(backward, back, np.where(forward, turned * forth, 0)),
        known=has_next | has_last,
    )


def from_border(w: Window, cost: Floats, entry: Floats) -> Floats:
    """Cost of the cheapest path from the border of its frame to each node; 0 where ignored pixels cut it off.

    Parameters
    ----------
    cost
        (edges) cost of a step.
    entry
        (nodes) cost of starting at a node of the rim.
    """
    nodes, rim = len(w.frame), np.flatnonzero(w.rim)
    source = np.full(len(rim), nodes)
    value = np.r_[cost, cost, entry[rim]] + 1e-9  # scipy takes an explicit zero for no edge
    row, column = np.r_[w.edge[:, 0], w.edge[:, 1], source], np.r_[w.edge[:, 1], w.edge[:, 0], rim]
    graph = sp.csr_array((value, (row, column)), (nodes + 1, nodes + 1))
    distance = dijkstra(graph, indices=nodes)[:nodes]
    return np.where(np.isfinite(distance), distance, 0.0)


def colour_distance(w: Window, pairs: Ints) -> Floats:
    """(n) distance in Lab of n pairs of nodes (n, 2)."""
    lightness, a, b = (w.colour[pairs[:, 0]] - w.colour[pairs[:, 1]]).T
    return np.asarray(np.sqrt(lightness**2 + a**2 + b**2))


def similarity(w: Window, colour: float, time: float) -> sp.csr_array:
    """Symmetric weights (nodes, nodes): boundary length, or carried pixels, times exp(-distance in Lab / ``colour``).

    Each kind is scaled to a mean degree of 1, then those in time are multiplied by ``time``.
    """
    nodes = len(w.frame)

    def part(pairs: Ints, strength: Floats, distance: Floats) -> sp.csr_array:
        strength = strength * np.exp(-distance / colour)
        i, j = pairs.T
        half = np.r_[strength, strength] * (nodes / max(2 * strength.sum(), 1e-9))
        return sp.csr_array((half, (np.r_[i, j], np.r_[j, i])), (nodes, nodes))

    space = part(w.edge, w.boundary, w.edge_colour)
    return sp.csr_array(space + time * part(w.link, w.carried, colour_distance(w, w.link)))


def diffuse(
    weight: sp.csr_array, x: Floats, strength: float, trust: Floats | None = None, tolerance: float = 1e-2
) -> Floats:
    """The z that minimises sum trust (z - x)^2 + strength z' (D - W) z.

    Conjugate gradients with the diagonal as preconditioner, from x, up to a relative residual of ``tolerance``.

    Parameters
    ----------
    weight
        W (n, n), symmetric; D is the diagonal of its row sums.
    x
        (n), or (n, 2) for two at once.
    trust
        (n) above 0; 1 where it is not given.
    """
    data = np.ones(len(x), np.float32) if trust is None else trust.astype(np.float32)
    columns = np.zeros((len(x), 2), np.float32)
    columns[:, : x[0].size if len(x) else 1] = x.reshape(len(x), -1)
    z = kernels.conjugate_gradients(
        weight.indptr, weight.indices, weight.data.astype(np.float32), data, columns, strength, tolerance, 200
    )
    return np.asarray(z[:, : x[0].size].reshape(x.shape), np.float64)


def windowed(rows: Floats, radius: int) -> Floats:
    """Sums of the rows t - radius to t + radius of a table (frames, n)."""
    sums, t = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, 0)]), np.arange(len(rows))
    return np.asarray(sums[np.minimum(t + radius + 1, len(rows))] - sums[np.maximum(t - radius, 0)])
