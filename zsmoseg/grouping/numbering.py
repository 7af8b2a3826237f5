"""Numbers of groups and of instances, by falling size.

Connected components: Hopcroft, Tarjan, CACM 1973, as implemented in SciPy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from zsmoseg.grouping.clustering import Labels, by_weight
from zsmoseg.motion.models import Floats


def renumbered(group: Labels, support: Floats) -> Labels:
    """Moving groups (N,) 1.. by falling size, 0 = static.

    Parameters
    ----------
    support : (N,) pixels of every object.
    """
    return _of_movers(group, group, support)


def connected(group: Labels, near: NDArray[np.bool_], support: Floats) -> Labels:
    """Instances (N,) 1.. by falling size, 0 = static: what is connected by nearness (N, N) within a group."""
    link = near & (group[:, None] == group[None, :]) & (group[:, None] > 0)
    return _of_movers(group, connected_components(csr_array(link), directed=False)[1], support)


def _of_movers(group: Labels, name: NDArray[np.integer], support: Floats) -> Labels:
    out, moving = np.zeros_like(group), group > 0
    if moving.any():
        out[moving] = by_weight(name[moving], support[moving])
    return out


def carried(number: Labels, before: Labels, weight: Floats, last: int) -> Labels:
    """The numbers (N,) of a window in those of the windows before it, for the objects that both have numbered.

    A number goes on as the one that it shares the most weight with, each as one only; the others go on counting from
    ``last``.

    Parameters
    ----------
    number, before : (N,) of each object in this window, and in those before it; 0 = none.
    weight : (N,).
    """
    both = (number > 0) & (before > 0)
    pairs, row = np.unique(np.stack([before[both], number[both]], 1), axis=0, return_inverse=True)
    shared = np.bincount(row.ravel(), weight[both], len(pairs))
    name = np.zeros(int(number.max(initial=0)) + 1, np.int64)
    for old, new in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], -shared))]:
        if name[new] == 0 and old not in name:
            name[new] = old
    fresh = np.flatnonzero(name[1:] == 0) + 1
    name[fresh] = last + np.arange(1, len(fresh) + 1)
    return name[number]
