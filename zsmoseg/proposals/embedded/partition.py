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

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from zsmoseg.proposals.embedded.absorption import absorb
from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints
from zsmoseg.proposals.embedded.contraction import contract
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.signed_graph import SignedGraph


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


def partition(graph: Graph, foreground: Bools, parameters: Partition) -> Ints:
    """(superpixels) the part of the ``foreground`` (superpixels) that each is in; others are parts of their own."""
    signed = signed_graph(graph, foreground, parameters)
    part = chains(graph, foreground)  # far fewer nodes are left to contract
    part = contract(part, signed.between(part))
    return absorb(part, signed.between(part), graph.size, parameters.part_share)


def signed_graph(graph: Graph, foreground: Bools, parameters: Partition) -> SignedGraph:
    """The edges of the multicut of the ``foreground`` (superpixels).

    Neighbours: length of the boundary times 1 - step / neutral. The step of the flow is the smaller one of forward
    and backward, as flow bleeds over a boundary in one of them. Neutral is ``part_ratio`` times the median step of
    the frame's foreground, as limbs, turns and zooms have steps everywhere, and at least ``part_least``.
    Links: ``part_link`` of the carried pixels. Frames without any flow have links only.
    """
    edge = foreground[graph.edge].all(1) & graph.known[graph.frame[graph.edge[:, 0]]]
    link = foreground[graph.link].all(1)
    step, frame = np.minimum(*graph.edge_flow)[edge], graph.frame[graph.edge[edge, 0]]
    usual = np.array([np.median(part) if len(part) else 0.0 for part in _by_frame(step, frame, graph.frames)])
    neutral = np.maximum(parameters.part_ratio * usual, parameters.part_least)[frame]
    boundary, carried = graph.boundary[edge], parameters.part_link * graph.carried[link]
    return SignedGraph(
        np.concatenate([graph.edge[edge], graph.link[link]]),
        np.r_[boundary * (1 - step / neutral), carried],
        np.r_[boundary, carried],
    )


def _by_frame(x: Floats, frame: Ints, frames: int) -> list[Floats]:
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
    chained = sp.coo_array((np.ones(len(i)), (i, j)), (len(foreground),) * 2)
    label = connected_components(chained, directed=False)[1]
    return np.asarray(np.unique(label, return_index=True)[1][label], np.int64)
