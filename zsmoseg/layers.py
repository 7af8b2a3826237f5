"""Which parts of the foreground move apart, over the frames of a window: two movers that touch are two layers.

A decomposition of the graph in space and time. Neighbours whose flow agrees attract each other, neighbours across
a step of the flow repel each other, and a superpixel attracts what the flow carries it to. Sums along the whole
common boundary and over all frames decide, so a weak spot of a boundary joins nothing, and two things that touch
in some frames only are told apart by all others.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from zsmoseg import kernels, settings
from zsmoseg.spacetime import Floats, Ints, Window


@dataclass(frozen=True)
class Ties:
    """What holds pairs of nodes, or of larger parts, together."""

    pair: Ints
    """(n, 2)."""
    pull: Floats
    """(n) px: above 0 they attract, below 0 they repel."""
    contact: Floats
    """(n) px: the largest pull that is possible."""

    def between(self, part: Ints) -> Ties:
        """The ties between the parts (nodes) that nodes are in, summed; the pairs in ascending order."""
        i, j = part[self.pair].T
        apart, nodes = i != j, len(part)
        key, row = np.unique((np.minimum(i, j) * nodes + np.maximum(i, j))[apart], return_inverse=True)
        pull, contact = (
            np.asarray(np.bincount(row, x[apart], len(key)), np.float64) for x in (self.pull, self.contact)
        )
        return Ties(np.stack([key // nodes, key % nodes], 1), pull, contact)


def layers(w: Window, foreground: NDArray[np.bool_], s: settings.Objects) -> Ints:
    """(nodes) layer that a node of the foreground is in; the others are layers of their own.

    Parameters
    ----------
    foreground
        (nodes).
    s
        The settings ``part_*`` are read.
    """
    ties = attraction(w, foreground, s)
    part = chains(w, foreground)
    part = contract(part, ties.between(part))
    return absorb(part, ties.between(part), w.size, s.part_share)


def attraction(w: Window, foreground: NDArray[np.bool_], s: settings.Objects) -> Ties:
    """The ties of the nodes of the foreground.

    Neighbours: length of the boundary times 1 - step / neutral. The step of the flow is the smaller one of forth
    and back, as flow bleeds over a boundary in one of them. Neutral is ``part_ratio`` times the median step of
    the frame's foreground, as limbs, turns and zooms have steps everywhere, and at least ``part_least``.
    Links: ``part_link`` of the carried pixels. Frames without any flow have links only.
    """
    edge = foreground[w.edge].all(1) & w.known[w.frame[w.edge[:, 0]]]
    link = foreground[w.link].all(1)
    step, frame = np.minimum(*w.edge_flow)[edge], w.frame[w.edge[edge, 0]]
    usual = np.array([np.median(part) if len(part) else 0.0 for part in _by_frame(step, frame, w.frames)])
    neutral = np.maximum(s.part_ratio * usual, s.part_least)[frame]
    boundary, carried = w.boundary[edge], s.part_link * w.carried[link]
    return Ties(
        np.concatenate([w.edge[edge], w.link[link]]),
        np.r_[boundary * (1 - step / neutral), carried],
        np.r_[boundary, carried],
    )


def _by_frame(x: Floats, frame: Ints, frames: int) -> list[Floats]:
    """``x`` cut into frames, which ascend."""
    return np.split(x, np.searchsorted(frame, np.arange(1, frames)))


def chains(w: Window, foreground: NDArray[np.bool_]) -> Ints:
    """(nodes) first node of the chain that a node is in: links that carry the most of both their ends."""
    link = np.flatnonzero(foreground[w.link].all(1) & (w.carried > 0))
    order = link[np.argsort(w.carried[link], kind="stable")]
    following, followed = np.full((2, len(foreground)), -1)
    i, j = w.link[order].T
    following[i], followed[j] = order, order  # of those that are assigned to one place the last one stays
    i, j = w.link[link].T
    i, j = w.link[link[(following[i] == link) & (followed[j] == link)]].T
    graph = sp.coo_array((np.ones(len(i)), (i, j)), (len(foreground),) * 2)
    label = connected_components(graph, directed=False)[1]
    return np.asarray(np.unique(label, return_index=True)[1][label], np.int64)


def contract(part: Ints, ties: Ties) -> Ints:
    """Join the two parts that attract each other most, sum their ties to the others, until all repel each other.

    Greedy additive edge contraction (Keuper et al. 2015, arXiv:1505.06973).

    Parameters
    ----------
    part
        (nodes) a node that stands for the part that a node is in.
    ties
        Between the parts.

    Returns
    -------
    part
        (nodes) the same of the joined parts.
    """
    if not len(ties.pair):
        return part
    there, pair = np.unique(ties.pair, return_inverse=True)
    into = kernels.contract(pair.reshape(-1, 2), ties.pull, len(there))
    return _follow(part, there, there[into])


def absorb(part: Ints, ties: Ties, size: Floats, share: float) -> Ints:
    """Give parts smaller than ``share`` of the largest that they touch to the one that repels them least per contact.

    Parameters
    ----------
    part, ties
        As in ``contract``.
    size
        (nodes) px.
    """
    pulls, contacts = _neighbours(ties.pair, ties.pull), _neighbours(ties.pair, ties.contact)
    total = np.bincount(part, size, len(part)).tolist()
    queue = [(total[p], p) for p in pulls]
    heapify(queue)
    into: dict[int, int] = {}
    while queue:
        pixels, p = heappop(queue)
        if (
            p in into
            or total[p] != pixels
            or not pulls[p]
            or pixels >= share * max(total[q] for q in pulls[p])
        ):
            continue
        best = max(pulls[p], key=lambda q: (pulls[p][q] / max(contacts[p][q], 1e-9), -q))
        into[p] = best
        total[best] += pixels
        _merge(pulls, best, p)
        _merge(contacts, best, p)
        heappush(queue, (total[best], best))
    return _follow(part, np.array(list(into), np.int64), np.array(list(into.values()), np.int64))


def _neighbours(pair: Ints, value: Floats) -> dict[int, dict[int, float]]:
    """Value by one part and the other, both ways round."""
    found: dict[int, dict[int, float]] = {p: {} for p in np.unique(pair).tolist()}
    for (p, q), x in zip(pair.tolist(), value.tolist(), strict=True):
        found[p][q] = found[q][p] = x
    return found


def _merge(values: dict[int, dict[int, float]], p: int, q: int) -> None:
    """Let ``p`` take over what ``q`` has."""
    others = values.pop(q)
    del values[p][q], others[p]
    for r, x in others.items():
        del values[r][q]
        values[p][r] = values[r][p] = values[p].get(r, 0.0) + x


def _follow(part: Ints, old: Ints, new: Ints) -> Ints:
    """The part that each part has ended in, where ``old`` ones have gone into ``new`` ones."""
    target = np.arange(len(part))
    target[old] = new
    while (target != target[target]).any():
        target = target[target]
    return np.asarray(target[part], np.int64)
