"""Which parts of the foreground move apart, over the frames of a window: two movers that touch are two parts.

A multicut of the graph in space and time. Neighbours whose flow agrees attract each other, neighbours across
a step of the flow repel each other, and a superpixel attracts what the flow carries it to. Sums along the whole
common boundary and over all frames decide, so a weak spot of a boundary joins nothing, and two objects that touch
in some frames only are told apart by all others.

Source: Keuper, Levinkov, Bonneel, Lavoué, Brox, Andres, "Efficient decomposition of image and mesh graphs by lifted
multicuts", ICCV 2015, and "Motion trajectory segmentation via minimum cost multicuts", ICCV 2015 (Keuper, Andres, Brox).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.proposals.embedded.absorption import absorb
from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints
from zsmoseg.proposals.embedded.components import components
from zsmoseg.proposals.embedded.contraction import contract
from zsmoseg.proposals.embedded.features_loops import U, V
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.signed_graph import SignedGraph

BLOCK = 16
"""Frames of which pairs from afar are looked for at once."""
PIECES = 32
"""Pieces of a frame that are compared with one another."""


@dataclass(frozen=True, kw_only=True)
class Partition:
    """What attracts and what repels."""

    part_ratio: float = 2.5
    """Step of the flow over the median in the frame's foreground at which neighbours move apart. Halved or doubled it changes J by nothing."""
    part_least: float = 1.0
    """Steps below this never part neighbours, px. Halved or doubled it changes J by nothing."""
    part_link: float = 0.25
    """Attraction of a pixel that the flow carries on, over that of one of a boundary. Halved or doubled it changes J by nothing."""
    part_share: float = 0.05
    """Smallest part that is one of its own, over the largest beside it. Halved or doubled it changes J by nothing."""
    far_steps: int = 3
    """Steps from neighbour to neighbour between superpixels that may repel each other from afar: flow bleeds over a border by two."""
    far_ratio: float = 6.0
    """Step of the flow over the median of such pairs in the frame's foreground from which they do."""


def partition(graph: Graph, foreground: Bools, parameters: Partition) -> tuple[Ints, Ints]:
    """(superpixels) each: the whole, and the part of it, of the ``foreground`` (superpixels); others are parts of their own.

    Neighbours hold a whole together. Where two things touch, flow bleeds over the border, and nowhere is there a step: so
    pairs some superpixels apart repel each other where the flow differs, and so do pieces of one frame with background
    between them; both part the wholes once more. A limb may be such a part, too: whether parts move apart is not for them
    to say.

    Source: lifted edges of Keuper et al., "Efficient decomposition of image and mesh graphs by lifted multicuts".
    """
    chained, near = chains(graph, foreground), signed_graph(graph, foreground, parameters)
    lifted = near.joined(far_graph(graph, foreground, parameters)).joined(
        apart_graph(graph, foreground, parameters)
    )
    whole, part = (
        contract(chained, signed.between(chained)) for signed in (near, lifted)
    )  # chains: far fewer nodes
    whole, part = (absorb(x, near.between(x), graph.size, parameters.part_share) for x in (whole, part))
    return whole, part


def signed_graph(graph: Graph, foreground: Bools, parameters: Partition) -> SignedGraph:
    """The edges of the multicut of the ``foreground`` (superpixels).

    Neighbours: length of the boundary times 1 - step / neutral. The step of the flow is the smaller one of forward
    and backward, as flow bleeds over a boundary in one of them. Neutral is ``part_ratio`` times the median step of
    the frame's foreground, as limbs, turns and zooms have steps everywhere, and at least ``part_least``.
    Links: ``part_link`` of the carried pixels. Frames without any flow have links only.
    """
    edge = foreground[graph.edge].all(1) & graph.known[graph.frame[graph.edge[:, 0]]]
    link = foreground[graph.link].all(1)
    boundary, carried = graph.boundary[edge], parameters.part_link * graph.carried[link]
    agrees = agreement(graph, graph.edge[edge], parameters.part_ratio, parameters.part_least)
    return SignedGraph(
        np.concatenate([graph.edge[edge], graph.link[link]]),
        np.r_[boundary * agrees, carried],
        np.r_[boundary, carried],
    )


def far_graph(graph: Graph, foreground: Bools, parameters: Partition) -> SignedGraph:
    """What repels each other from afar: pairs of the ``foreground`` of a frame, ``far_steps`` from neighbour to neighbour apart.

    Neutral is ``far_ratio`` times the median step of such pairs. Each crosses ``far_steps`` boundaries; where all are cut, they
    weigh as much as these, and repel by no more than that.
    """
    known = foreground & graph.has_flow
    edge = known[graph.edge].all(1)
    # some frames at a time: the pairs of a whole window that do not repel take several times its memory
    blocks = np.split(
        graph.edge[edge],
        np.searchsorted(graph.frame[graph.edge[edge, 0]], np.arange(BLOCK, graph.frames, BLOCK)),
    )
    pair = np.concatenate([far_pairs(block, parameters.far_steps) for block in blocks])
    agrees = agreement(graph, pair, parameters.far_ratio, parameters.part_least)
    usual = graph.boundary[edge].sum() / max(len(pair) * parameters.far_steps, 1)
    pair, agrees = pair[agrees < 0], agrees[agrees < 0]
    return SignedGraph(pair, usual * np.maximum(agrees, -1), np.full(len(pair), usual))


def apart_graph(graph: Graph, foreground: Bools, parameters: Partition) -> SignedGraph:
    """What repels each other across the background: connected pieces of the ``foreground`` of a frame, by their median flow.

    Two things that touch at last are two if they moved apart before. Neutral is that of neighbours. A pair weighs what its
    contact might be, the side of the smaller piece, and repels by no more. Each piece is stood for by the superpixel whose flow is
    most like its median; of a frame in shreds the ``PIECES`` largest count.
    """
    known = foreground & graph.has_flow
    node = np.flatnonzero(known)
    if not len(node):
        return SignedGraph(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0))
    piece = np.unique(components(known, graph.edge)[node], return_inverse=True)[1].ravel()
    number = np.arange(piece.max() + 1)
    flow = np.concatenate([graph.forward[node][:, [U, V]], graph.backward[node][:, [U, V]]], 1)
    middle = np.stack([scipy.ndimage.median(x, piece, number) for x in flow.T], 1)
    alike = np.lexsort((np.abs(flow - middle[piece]).sum(1), piece))
    stand = node[alike[np.searchsorted(piece[alike], number)]]
    size, frame = np.bincount(piece, graph.size[node]), graph.frame[stand]
    falling = np.lexsort((-size, frame))
    large = np.sort(falling[number - np.searchsorted(frame, frame) < PIECES])
    number, stand, middle, side = np.arange(len(large)), stand[large], middle[large], np.sqrt(size[large])
    pairs = [
        here[np.stack(np.triu_indices(len(here), 1), 1)]
        for here in _by_frame(number, graph.frame[stand], graph.frames)
    ]
    i, j = np.concatenate(pairs).T
    apart = middle[i] - middle[j]
    step = np.minimum(np.hypot(*apart[:, :2].T), np.hypot(*apart[:, 2:].T))
    edge = known[graph.edge].all(1)
    beside, of = np.minimum(*graph.edge_flow)[edge], graph.frame[graph.edge[edge, 0]]
    neutral = neutral_steps(beside, of, graph.frames, parameters.part_ratio, parameters.part_least)
    agrees = 1 - step / neutral[graph.frame[stand[i]]]
    i, j, agrees = i[agrees < 0], j[agrees < 0], agrees[agrees < 0]
    weight = np.minimum(side[i], side[j])
    return SignedGraph(np.stack([stand[i], stand[j]], 1), weight * np.maximum(agrees, -1), weight)


def neutral_steps(step: Floats, frame: Ints, frames: int, ratio: float, least: float) -> Floats:
    """(F) step of the flow at which pairs do not care: ``ratio`` medians of those (n) of a frame, frames ascending, ``least`` px at least."""
    parts = _by_frame(step, frame, frames)
    return np.maximum(ratio * np.array([np.median(part) if len(part) else 0.0 for part in parts]), least)


def agreement(graph: Graph, pair: Ints, ratio: float, least: float) -> Floats:
    """(n) of pairs (n, 2) of one frame, frames ascending: 1 - step / neutral."""
    step, frame = np.minimum(*graph.steps(pair)), graph.frame[pair[:, 0]]
    return np.asarray(1 - step / neutral_steps(step, frame, graph.frames, ratio, least)[frame])


def far_pairs(edge: Ints, steps: int) -> Ints:
    """(n, 2) pairs of nodes that are just so many steps along edges (m, 2) apart, in order."""
    node, local = np.unique(edge, return_inverse=True)
    i, j = local.reshape(-1, 2).T
    step = scipy.sparse.csr_array(
        (np.ones(2 * len(i), np.float32), (np.r_[i, j], np.r_[j, i])), (len(node), len(node))
    )
    before = within = scipy.sparse.eye_array(len(node), dtype=np.float32, format="csr")
    for _ in range(steps):
        before, within = within, within @ step + within
        within.data[:] = 1
    ring = scipy.sparse.triu(within - before, 1).tocoo()
    pair = np.stack([ring.row, ring.col], 1)[ring.data > 0]
    return np.asarray(node[pair[np.lexsort((pair[:, 1], pair[:, 0]))]], np.int64)


def _by_frame(x: NDArray[Any], frame: Ints, frames: int) -> list[NDArray[Any]]:
    """``x`` cut into frames, which ascend."""
    return np.split(x, np.searchsorted(frame, np.arange(1, frames)))


def chains(graph: Graph, foreground: Bools) -> Ints:
    """(superpixels) first one of the chain that each is in: links that carry the most of both their ends."""
    link = np.flatnonzero(foreground[graph.link].all(1) & (graph.carried > 0))
    order = link[np.argsort(graph.carried[link], kind="stable")]
    following, followed = np.full((2, len(foreground)), -1)
    i, j = graph.link[order].T
    following[i], followed[j] = order, order  # of those that are assigned to one place the last one stays
    i, j = graph.link[link].T
    i, j = graph.link[link[(following[i] == link) & (followed[j] == link)]].T
    chained = scipy.sparse.coo_array((np.ones(len(i)), (i, j)), (len(foreground),) * 2)
    label = scipy.sparse.csgraph.connected_components(chained, directed=False)[1]
    return np.asarray(np.unique(label, return_index=True)[1][label], np.int64)
