"""Ids for the foreground: one for each layer, handed on from window to window by the frames they share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from zsmoseg.spacetime import Floats, Ints

Ids = NDArray[np.int32]
NONE = -1
"""Layer of what is no object."""


@dataclass
class Tracker:
    """Names the layers of the windows of a shot, which must come in order."""

    ids: Ids = field(default_factory=lambda: np.zeros(0, np.int32))
    """(nodes) object of each node of the frames named last, 0 = none."""
    last: int = 0
    """Largest id given so far."""

    def name(self, layer: Ints, size: Floats, known: int) -> Ids:
        """Objects of the next nodes.

        A layer takes the id that it shares the most pixels with where both are known; an id goes to one layer only.
        Others get new ids, in the order in which they appear.

        Parameters
        ----------
        layer, size
            (nodes) layer or ``NONE``, and px: of the last ``known`` nodes that have been named, then of new ones.
        """
        before, then, now = self.ids[len(self.ids) - known :], layer[:known], layer[known:]
        given: dict[int, int] = {NONE: 0}
        for old, new in _by_overlap(before, then, size[:known]):
            if new not in given and old not in given.values():
                given[new] = old
        found, first = np.unique(now, return_index=True)
        for new in found[np.argsort(first)].tolist():
            if new not in given:
                self.last += 1
                given[new] = self.last
        name = np.array([given[new] for new in found.tolist()], np.int32)
        self.ids = np.concatenate([before, name[np.searchsorted(found, now)]])
        return self.ids[known:]


def _by_overlap(before: Ids, layer: Ints, size: Floats) -> list[tuple[int, int]]:
    """Id and layer of all that overlap, the largest overlap first."""
    both = (before > 0) & (layer != NONE)
    pairs, row = np.unique(np.stack([before[both], layer[both]], 1), axis=0, return_inverse=True)
    overlap = np.bincount(row.ravel(), size[both], len(pairs))
    order = np.lexsort((pairs[:, 1], pairs[:, 0], -overlap))
    return [(int(old), int(new)) for old, new in pairs[order]]


def pieces(foreground: NDArray[np.bool_], layer: Ints, size: Floats, edge: Ints, smallest: float) -> Ints:
    """(nodes) the layer of what is large enough, else ``NONE``.

    Connected foreground of less than ``smallest`` px is dropped. A layer with less than that in a larger one
    is named like the largest layer there, so no foreground is lost.

    Parameters
    ----------
    foreground, layer, size
        (nodes) whether foreground, layer, px.
    edge
        (edges, 2) nodes of one frame that touch.
    """
    body = components(foreground, edge)
    key, part = np.unique(body * len(body) + layer, return_inverse=True)
    area = np.bincount(part, size, len(key))
    order = np.argsort(area, kind="stable")
    largest = np.zeros(len(body), np.int64)
    largest[key[order] // len(body)] = key[order] % len(body)  # the last one put in a place stays
    kept = np.where(area[part] < smallest, largest[body], layer)
    return np.where(foreground & (np.bincount(body, size)[body] >= smallest), kept, NONE)


def components(foreground: NDArray[np.bool_], edge: Ints) -> Ints:
    """(nodes) number of the connected piece of the foreground that a node is in; others are pieces of their own."""
    inside = edge[foreground[edge].all(1)]
    graph = sp.coo_array((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (len(foreground),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
