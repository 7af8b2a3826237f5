"""Numbers of groups, by falling size, and of instances: each has the number of its largest object.

Connected components: Hopcroft, Tarjan, CACM 1973, as implemented in SciPy.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Labels, by_weight
from zsmoseg.motion.models import Floats


def renumbered(group: Labels, support: Floats) -> Labels:
    """Moving groups (N,) 1.. by falling size, 0 = static.

    Parameters
    ----------
    support : (N,) pixels of every object.
    """
    out, moving = np.zeros_like(group), group > 0
    if moving.any():
        out[moving] = by_weight(group[moving], support[moving])
    return out


def connected(group: Labels, near: NDArray[np.bool_], support: Floats) -> Labels:
    """The largest object (N,) of what is connected by nearness (N, N) within a group; 0 = static."""
    link = near & (group[:, None] == group[None, :]) & (group[:, None] > 0)
    part = scipy.sparse.csgraph.connected_components(scipy.sparse.csr_array(link), directed=False)[1]
    return np.where(group > 0, _largest(part, support)[part], 0)


def _largest(name: NDArray[np.integer], support: Floats) -> Labels:
    """The object of most support, by name from 0 on; the first of equals, 0 where none has the name."""
    order = np.argsort(-support, kind="stable")
    names, first = np.unique(name[order], return_index=True)
    out = np.zeros(int(name.max(initial=-1)) + 1, np.int64)
    out[names] = order[first]
    return out


def carried(number: Labels, before: Labels, weight: Floats) -> Labels:
    """What the numbers 0, 1, .. of a window were called in the windows before it; 0 = they are new.

    A number goes on as the one that it shares the most weight with, each as one only.

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
    return name


def carried_groups(group: Labels, before: Labels, weight: Floats, last: int) -> Labels:
    """The groups (N,) of a window in the numbers of those before it; new ones go on counting from ``last``."""
    name = carried(group, before, weight)
    new = np.flatnonzero(name[1:] == 0) + 1
    name[new] = last + np.arange(1, len(new) + 1)
    return name[group]


def carried_instances(instance: Labels, before: Labels, weight: Floats, objects: Labels) -> Labels:
    """The instances (N,) of a window in the numbers of those before it; a new one has that of its largest new object.

    Parameters
    ----------
    objects : (N,) the numbers of the objects in the video.
    """
    name = carried(instance, before, weight)
    new = np.where(before == 0, instance, 0)
    largest = objects[_largest(new, weight)]
    fresh = np.flatnonzero(name[: len(largest)] == 0)
    name[fresh] = largest[fresh]
    return np.where(instance > 0, name[instance], 0)
