"""Connected pieces of the foreground: which are large enough.

Connected components: Hopcroft, Tarjan, CACM 1973, as implemented in SciPy.
"""

from __future__ import annotations

import numpy as np
import scipy

from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints

NONE = -1
"""Part of what is no object."""


def tidy(foreground: Bools, part: Ints, size: Floats, edge: Ints, smallest: float) -> Ints:
    """(superpixels) the part of what is large enough, else ``NONE``.

    Connected foreground of less than ``smallest`` px is dropped. A part with less than that in a larger one
    is named like the largest part there, so no foreground is lost.

    Parameters
    ----------
    foreground, part, size
        (superpixels) whether foreground, part, px.
    edge
        (edges, 2) superpixels of one frame that touch.
    """
    component = components(foreground, edge)
    key, piece = np.unique(component * len(component) + part, return_inverse=True)
    area = np.bincount(piece, size, len(key))
    order = np.argsort(area, kind="stable")
    largest = np.zeros(len(component), np.int64)
    largest[key[order] // len(component)] = key[order] % len(component)  # the last one put in a place stays
    kept = np.where(area[piece] < smallest, largest[component], part)
    return np.where(foreground & (np.bincount(component, size)[component] >= smallest), kept, NONE)


def components(foreground: Bools, edge: Ints) -> Ints:
    """(superpixels) number of the connected component of the foreground; others are components of their own."""
    inside = edge[foreground[edge].all(1)]
    graph = scipy.sparse.coo_array(
        (np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (len(foreground),) * 2
    )
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)
