"""Values spread over neighbours and links of like colour: the frames around decide together.

Source: regularisation with the Laplacian of a graph, Zhou, Bousquet, Lal, Weston, Schölkopf, "Learning with local and
global consistency", NIPS 2003.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from zsmoseg.proposals.embedded.aliases import Floats, Ints
from zsmoseg.proposals.embedded.conjugate_gradients import conjugate_gradients
from zsmoseg.proposals.embedded.graph import Graph, colour_distance

ROUNDS = 200
"""Most steps of the solver; it ends far earlier."""
LEAST = 1e-9
"""Smallest sum that is divided by."""


@dataclass(frozen=True)
class Diffusion:
    """How far values spread."""

    link_colour: float
    """Colour distance at which a tie loses 63 %, Lab."""
    link_time: float
    """Weight of links in time over that of neighbours."""
    spread: float
    """Strength of the diffusion over that of what is measured."""
    tolerance: float = 1e-2
    """Residual of the equations over their right side at which the solver stops: finer changes no mask."""


def similarity(graph: Graph, diffusion: Diffusion) -> scipy.sparse.csr_array:
    """Symmetric weights (superpixels, superpixels) of all ties.

    Boundary length, or carried pixels, times exp(-distance in Lab / ``link_colour``). Each kind is scaled to a mean
    degree of 1, then the links in time are multiplied by ``link_time``.
    """
    nodes = len(graph.frame)

    def part(pairs: Ints, strength: Floats, distance: Floats) -> scipy.sparse.csr_array:
        strength = strength * np.exp(-distance / diffusion.link_colour)
        i, j = pairs.T
        half = np.r_[strength, strength] * (nodes / max(2 * strength.sum(), LEAST))
        return scipy.sparse.csr_array((half, (np.r_[i, j], np.r_[j, i])), (nodes, nodes))

    space = part(graph.edge, graph.boundary, graph.edge_colour)
    time = part(graph.link, graph.carried, colour_distance(graph, graph.link))
    return scipy.sparse.csr_array(space + diffusion.link_time * time)


def diffuse(
    weight: scipy.sparse.csr_array, x: Floats, strength: float, tolerance: float, trust: Floats | None = None
) -> Floats:
    """The z that minimises sum trust (z - x)² + strength z' (D - W) z.

    Parameters
    ----------
    weight
        W (n, n), symmetric; D is the diagonal of its row sums.
    x
        (n), or (n, 2) for two at once.
    strength
        Of the ties over that of x.
    tolerance
        Norm of the residual over that of trust x at which the solver stops.
    trust
        (n) above 0; 1 where it is not given.

    Returns
    -------
    Of the shape of ``x``.
    """
    data = np.ones(len(x), np.float32) if trust is None else trust.astype(np.float32)
    columns = np.zeros((len(x), 2), np.float32)
    given = x[0].size if len(x) else 1
    columns[:, :given] = x.reshape(len(x), -1)
    matrix = weight.indptr, weight.indices, weight.data.astype(np.float32)
    z = conjugate_gradients(*matrix, data, columns, strength, tolerance, ROUNDS)
    return np.asarray(z[:, :given].reshape(x.shape), np.float64)
