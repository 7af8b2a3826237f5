"""Graphs of which a multicut is sought: edges that attract and edges that repel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats, Ints


@dataclass(frozen=True)
class SignedGraph:
    """What holds pairs of superpixels, or of parts of many, together."""

    pair: Ints
    """(n, 2)."""
    attraction: Floats
    """(n) px: above 0 they attract, below 0 they repel."""
    contact: Floats
    """(n) px: the largest attraction that is possible."""

    def joined(self, other: SignedGraph) -> SignedGraph:
        """Its edges and those of another."""
        return SignedGraph(
            np.concatenate([self.pair, other.pair]),
            np.r_[self.attraction, other.attraction],
            np.r_[self.contact, other.contact],
        )

    def between(self, part: Ints) -> SignedGraph:
        """The edges between the parts (superpixels) that superpixels are in, summed; the pairs in ascending order."""
        i, j = part[self.pair].T
        apart, nodes = i != j, len(part)
        key, row = np.unique((np.minimum(i, j) * nodes + np.maximum(i, j))[apart], return_inverse=True)
        attraction, contact = (
            np.asarray(np.bincount(row, x[apart], len(key)), np.float64)
            for x in (self.attraction, self.contact)
        )
        return SignedGraph(np.stack([key // nodes, key % nodes], 1), attraction, contact)


def renamed_nodes(part: Ints, old: Ints, new: Ints) -> Ints:
    """(superpixels) the part that each ``part`` has ended in, where ``old`` ones have gone into ``new`` ones (n)."""
    target = np.arange(len(part))
    target[old] = new
    while (target != target[target]).any():
        target = target[target]
    return np.asarray(target[part], np.int64)
