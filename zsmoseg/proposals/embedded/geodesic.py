"""How well a superpixel is closed off from the border of its frame.

Source: Wei, Wen, Zhu, Sun, "Geodesic saliency using background priors", ECCV 2012: what is background is joined to
the border of the image by a cheap path.
"""

from __future__ import annotations

import numpy as np
import scipy

from zsmoseg.proposals.embedded.aliases import Floats
from zsmoseg.proposals.embedded.graph import Graph

STEP_LEAST = 1e-9
"""Added to every cost: a sparse graph takes an explicit zero for no edge."""


def from_border(graph: Graph, cost: Floats, entry: Floats) -> Floats:
    """Geodesic distance from the border: cost of the cheapest path from the border of its frame to each superpixel.

    Parameters
    ----------
    cost
        (edges) cost of a step.
    entry
        (superpixels) cost of starting at one of the rim.

    Returns
    -------
    (superpixels): 0 where ignored pixels cut it off.
    """
    nodes, rim = len(graph.frame), np.flatnonzero(graph.rim)
    border = np.full(len(rim), nodes)  # one node more, the border, begins all paths of all frames
    value = np.r_[cost, cost, entry[rim]] + STEP_LEAST
    one, two = graph.edge.T
    start, end = np.r_[one, two, border], np.r_[two, one, rim]
    distance = scipy.sparse.csgraph.dijkstra(
        scipy.sparse.csr_array((value, (start, end)), (nodes + 1, nodes + 1)), indices=nodes
    )[:nodes]
    return np.where(np.isfinite(distance), distance, 0.0)
