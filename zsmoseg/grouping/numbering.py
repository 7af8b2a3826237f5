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
