"""Small parts go to larger ones: limbs and scraps are no objects of their own."""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats, Ints
from zsmoseg.proposals.embedded.signed_graph import SignedGraph, renamed_nodes

LEAST = 1e-9
"""Smallest contact that is divided by, px."""
Values = dict[int, dict[int, float]]
"""By one part and the other, both ways round."""


def absorb(part: Ints, signed: SignedGraph, size: Floats, share: float) -> Ints:
    """Give parts smaller than ``share`` of the largest that they touch to the one that repels them least per contact.

    The smallest part goes first.

    Parameters
    ----------
    part, signed
        As in ``contraction.contract``.
    size
        (superpixels) px.
    share
        0 to 1.

    Returns
    -------
    (superpixels) a superpixel that stands for the part that each is in.
    """
    attractions, contacts = (
        _neighbours(signed.pair, signed.attraction),
        _neighbours(signed.pair, signed.contact),
    )
    total = np.bincount(part, size, len(part)).tolist()
    queue = [(total[p], p) for p in attractions]
    heapify(queue)
    into: dict[int, int] = {}
    while queue:
        pixels, p = heappop(queue)
        if p in into or total[p] != pixels:  # gone, or grown since
            continue
        beside = attractions[p]
        if not beside or pixels >= share * max(total[q] for q in beside):
            continue
        best = max(beside, key=lambda q: (attractions[p][q] / max(contacts[p][q], LEAST), -q))
        into[p] = best
        total[best] += pixels
        _merge(attractions, best, p)
        _merge(contacts, best, p)
        heappush(queue, (total[best], best))
    return renamed_nodes(part, np.array(list(into), np.int64), np.array(list(into.values()), np.int64))


def _neighbours(pair: Ints, value: Floats) -> Values:
    found: Values = {p: {} for p in np.unique(pair).tolist()}
    for (p, q), x in zip(pair.tolist(), value.tolist(), strict=True):
        found[p][q] = found[q][p] = x
    return found


def _merge(values: Values, p: int, q: int) -> None:
    """Let ``p`` take over what ``q`` has."""
    others = values.pop(q)
    del values[p][q], others[p]
    for r, x in others.items():
        del values[r][q]
        values[p][r] = values[r][p] = values[p].get(r, 0.0) + x
