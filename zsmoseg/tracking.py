"""Ids for the pieces of the foreground: connected in the frame, handed on from frame to frame along the flow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from zsmoseg.spacetime import Floats, Ints

Ids = NDArray[np.int32]


@dataclass
class Tracker:
    """Names the pieces of the frames of a shot, which must come in order."""

    smallest: float
    """Area below which a piece is dropped, px."""
    ids: Ids = field(default_factory=lambda: np.zeros(0, np.int32))
    """(nodes) object of each node of the frame before, 0 = none."""
    last: int = 0
    """Largest id given so far."""

    def step(
        self, foreground: NDArray[np.bool_], size: Floats, edge: Ints, link: Ints, carried: Floats
    ) -> Ids:
        """Objects of the next frame.

        A piece takes the id of the piece before that hands on the most pixels to it; an id goes to one piece only.

        Parameters
        ----------
        foreground, size
            (nodes) which superpixels are foreground, and their areas in px.
        edge
            (edges, 2) superpixels of the frame that touch.
        link, carried
            (links, 2) superpixel of the frame before and of this one, and (links) the weight of that link.
        """
        piece = components(foreground, edge)
        area = np.bincount(piece[foreground], size[foreground], len(size))
        good = foreground & (area[piece] >= self.smallest)
        name = np.zeros(len(size), np.int32)
        for before, now in self._by_overlap(piece, good, link, carried):
            if name[now] == 0 and before not in name:
                name[now] = before
        for new in np.unique(piece[good]):
            if name[new] == 0:
                self.last += 1
                name[new] = self.last
        self.ids = np.where(good, name[piece], 0).astype(np.int32)
        return self.ids

    def _by_overlap(
        self, piece: Ints, good: NDArray[np.bool_], link: Ints, carried: Floats
    ) -> NDArray[np.int64]:
        """(pairs, 2) id before and piece now of all that overlap, the largest overlap first."""
        i, j = link.T
        keep = (self.ids[i] > 0) & good[j] if len(link) else np.zeros(0, np.bool_)
        pairs = np.stack([self.ids[i[keep]].astype(np.int64), piece[j[keep]]], 1)
        pairs, row = np.unique(pairs, axis=0, return_inverse=True)
        overlap = np.bincount(row.ravel(), carried[keep], len(pairs))
        return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0], -overlap))])


def components(foreground: NDArray[np.bool_], edge: Ints) -> Ints:
    """(nodes) number of the connected piece of the foreground that a node is in; others are pieces of their own."""
    inside = edge[foreground[edge].all(1)]
    graph = sp.coo_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (len(foreground),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
