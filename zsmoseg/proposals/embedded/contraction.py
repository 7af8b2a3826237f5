"""Greedy additive edge contraction, a heuristic for the minimum cost multicut.

Source: Keuper, Levinkov, Bonneel, Lavoué, Brox, Andres, "Efficient decomposition of image and mesh graphs by lifted
multicuts", ICCV 2015, arXiv:1505.06973, algorithm 1.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import heapq

import numpy as np

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Floats, Ints
from zsmoseg.proposals.embedded.signed_graph import SignedGraph, renamed_nodes

Queue = list[tuple[float, int, int, int]]
"""A heap: - attraction, smaller part, larger part, edge. Equal attractions go by the parts, so there is one order."""


def contract(part: Ints, signed: SignedGraph) -> Ints:
    """Join the two parts that attract each other most, sum their edges to the others, until all repel each other.

    Parameters
    ----------
    part
        (superpixels) a superpixel that stands for the part that each is in.
    signed
        Between the parts.

    Returns
    -------
    (superpixels) the same of the joined parts.
    """
    if not len(signed.pair):
        return part
    nodes, pair = np.unique(signed.pair, return_inverse=True)
    into = contract_edges(pair.reshape(-1, 2), signed.attraction, len(nodes))
    return renamed_nodes(part, nodes, nodes[into])


@compiled
def contract_edges(pair: Ints, attraction: Floats, parts: int) -> Ints:
    """Contract edges from the one that attracts most on, as long as one attracts.

    The edges of a part are a linked list of their ends, 2 edge + side: the list of the part with fewer edges is
    handed over to the other, so an end moves a logarithmic number of times. What is out of date in the queue is
    skipped when it comes: its edge has another value or other ends, -1 where it is gone.

    Parameters
    ----------
    pair, attraction
        (n, 2) and (n): edges between parts, each pair of parts once.
    parts
        Number of parts.

    Returns
    -------
    (parts) part that each is joined to, itself where none.
    """
    value, end, into = attraction.copy(), pair.copy(), np.arange(parts)
    head, following, degree = _ends(end, parts)
    edge_of = {}
    queue = [(0.0, 0, 0, 0)]
    queue.clear()
    for edge in range(len(value)):
        p, q = end[edge].min(), end[edge].max()
        edge_of[p * parts + q] = edge
        if value[edge] > 0:
            queue.append((-value[edge], p, q, edge))
    heapq.heapify(queue)
    while len(queue) > 0:
        cost, p, q, strongest = heapq.heappop(queue)
        if end[strongest].min() != p or end[strongest].max() != q or value[strongest] != -cost:
            continue
        if degree[p] < degree[q]:
            p, q = q, p
        into[q] = p
        end[strongest] = -1
        degree[p] -= 1
        _hand_over(q, p, value, end, head, following, degree, edge_of, queue)
    return into


@compiled
def _ends(end: Ints, parts: int) -> tuple[Ints, Ints, Ints]:
    """The linked lists: (parts) first end, (2 n) the one after each end, -1 = none; (parts) number of edges."""
    head, following = np.full(parts, -1), np.full(2 * len(end), -1)
    degree = np.zeros(parts, np.int64)
    for edge in range(len(end)):
        for side in range(2):
            part = end[edge, side]
            following[2 * edge + side], head[part] = head[part], 2 * edge + side
            degree[part] += 1
    return head, following, degree


@compiled
def _hand_over(
    q: int,
    p: int,
    value: Floats,
    end: Ints,
    head: Ints,
    following: Ints,
    degree: Ints,
    edge_of: dict[int, int],
    queue: Queue,
) -> None:
    """Give the edges of part ``q`` to part ``p``; where ``p`` has one to the same part, the values are summed."""
    parts = len(head)
    half = head[q]
    while half >= 0:
        after, edge, side = following[half], half // 2, half % 2
        if end[edge, 0] >= 0:
            r = end[edge, 1 - side]
            key = min(p, r) * parts + max(p, r)
            if key in edge_of:
                kept = edge_of[key]
                value[kept] += value[edge]
                end[edge] = -1
                degree[r] -= 1
            else:
                kept = edge
                edge_of[key] = edge
                end[edge, side] = p
                following[half], head[p] = head[p], half
                degree[p] += 1
            if value[kept] > 0:
                heapq.heappush(queue, (-value[kept], min(p, r), max(p, r), kept))
        half = after
