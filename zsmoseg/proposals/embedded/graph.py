"""The superpixels of a window of frames as one graph: neighbours in a frame, and links along the flow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zsmoseg.flow.pairs import REPEAT
from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.features_loops import (
    DETAIL,
    ERROR,
    FLOW_FEATURES,
    RIM,
    SIZE,
    XX,
    XY,
    YY,
    A,
    B,
    L,
    U,
    V,
    X,
    Y,
)


@dataclass(frozen=True)
class Graph:
    """Frames ``start`` to ``start + F - 1`` of a shot; their superpixels are numbered through all of them."""

    start: int
    """Number of the first frame in its shot."""
    shape: tuple[int, int]
    """Height and width of the working grid, px."""
    offset: Ints
    """(F + 1) first superpixel of each frame."""
    frame: Ints
    """(superpixels) frame of each, counted from 0."""
    size: Floats
    """(superpixels) px."""
    place: Floats
    """(superpixels, 2) y, x in px."""
    colour: Floats
    """(superpixels, 3) L, a, b."""
    rim: Bools
    """(superpixels) whether it touches the border of the frame."""
    detail: Floats
    """(superpixels) mean square of the detail, grey levels²."""
    structure: Floats
    """(superpixels, 3) structure tensor: mean products xx, xy, yy of the slope of the detail, (grey levels / px)²."""
    edge: Ints
    """(edges, 2) neighbours in a frame."""
    boundary: Floats
    """(edges) length of the common boundary, px."""
    link: Ints
    """(links, 2) superpixels of one frame and the next."""
    carried: Floats
    """(links) pixels carried, both ways, each times its ``reliability``."""
    forward: Floats
    """(superpixels, 4) as in ``SuperpixelFeatures``; where there is none, ``backward`` turned around."""
    backward: Floats
    """(superpixels, 4) the same, towards the frame before."""
    has_flow: Bools
    """(superpixels) whether any flow of its own is known; where not, it has that of its neighbours, or 0, and no say."""

    @cached_property
    def known(self) -> Bools:
        """(F) whether a frame has any flow at all: not so between two repeats."""
        return np.bincount(self.frame, self.has_flow, self.frames) > 0

    @property
    def frames(self) -> int:
        """F."""
        return len(self.offset) - 1

    @cached_property
    def edge_colour(self) -> Floats:
        """(edges) distance in Lab of the two neighbours."""
        return colour_distance(self, self.edge)

    @cached_property
    def edge_flow(self) -> tuple[Floats, Floats]:
        """(edges) each: distance of the flow of the two neighbours, forward and backward, px."""
        return self.steps(self.edge)

    def steps(self, pairs: Ints) -> tuple[Floats, Floats]:
        """(n) each: distance of the flow of pairs (n, 2) of a frame, forward and backward, px."""
        i, j = pairs.T
        flows = (flow[:, [U, V]] for flow in (self.forward, self.backward))
        forward, backward = (np.hypot(*(flow[i] - flow[j]).T) for flow in flows)
        return forward, backward

    def of(self, frame: int) -> slice:
        """The superpixels of a frame."""
        return slice(self.offset[frame], self.offset[frame + 1])


def connect_frames(features: SuperpixelFeatures, start: int, shape: tuple[int, int]) -> Graph:
    """The graph of consecutive frames.

    Parameters
    ----------
    features
        Of F frames and F - 1 pairs, none of them a cut.
    start
        Number of the first frame in its shot.
    shape
        Height and width of the working grid, px.
    """
    frames, offset = len(features.superpixels), features.superpixel_offset
    column = list(features.feature.astype(np.float64).T)
    edge = features.edge.astype(np.int64) + offset[np.repeat(np.arange(frames), features.edges), None]
    boundary = features.boundary.astype(np.float64)
    raw = _flow(features)
    forward, backward = (filled(flow, edge, boundary) for flow in raw)
    pair = np.repeat(np.arange(frames - 1), features.links)
    link = features.link.astype(np.int64) + np.stack([offset[pair], offset[pair + 1]], 1)
    error = np.stack([forward[link[:, 0], ERROR], backward[link[:, 1], ERROR]], 1)
    moved = features.state != REPEAT
    frame = np.repeat(np.arange(frames), features.superpixels)
    after, before = (
        (has[frame] & ~np.isnan(flow[:, U]))[:, None]
        for has, flow in zip((np.r_[moved, False], np.r_[False, moved]), raw, strict=True)
    )
    turned = np.ones(FLOW_FEATURES)
    turned[[U, V]] = -1
    ahead = np.where(after, forward, np.where(before, turned * backward, np.nan))
    behind = np.where(before, backward, np.where(after, turned * forward, np.nan))
    return Graph(
        start=start,
        shape=shape,
        offset=offset,
        frame=frame,
        size=column[SIZE],
        place=np.stack([column[Y], column[X]], 1),
        colour=np.stack([column[L], column[A], column[B]], 1),
        rim=column[RIM] > 0,
        detail=column[DETAIL],
        structure=np.stack([column[XX], column[XY], column[YY]], 1),
        edge=edge,
        boundary=boundary,
        link=link,
        carried=(features.carried * reliability(error)).sum(1),
        forward=filled(ahead, edge, boundary),
        backward=filled(behind, edge, boundary),
        has_flow=(after | before)[:, 0],
    )


def filled(flow: Floats, edge: Ints, boundary: Floats) -> Floats:
    """(superpixels, n) ``flow``, where it is NaN with the mean of its neighbours, step by step; 0 where a frame has none.

    So nothing seems to move apart from what is unknown.

    Parameters
    ----------
    edge, boundary
        (edges, 2) neighbours, and (edges) the length of their boundary, px: their weight.
    """
    if not np.isnan(flow).any():
        return flow
    flow = flow.copy()
    (i, j), weight = np.r_[edge, edge[:, ::-1]].T, np.r_[boundary, boundary]
    for column in flow.T:
        while (step := ~np.isnan(column[i]) & np.isnan(column[j])).any():
            sums, total = (
                np.bincount(j[step], x, len(flow)) for x in (weight[step] * column[i[step]], weight[step])
            )
            column[total > 0] = sums[total > 0] / total[total > 0]
    return np.nan_to_num(flow)


def _flow(features: SuperpixelFeatures) -> tuple[Floats, Floats]:
    """(superpixels, 4) each: forward, 0 in the last frame, and backward, 0 in the first."""
    forward, backward = np.zeros((2, len(features.feature), FLOW_FEATURES))
    forward[: len(features.forward)] = features.forward
    backward[len(backward) - len(features.backward) :] = features.backward
    return forward, backward


def reliability(error: Floats) -> Floats:
    """0 to 1, of the same shape: how far flow counts that misses by ``error`` px forward and backward; half at 1 px."""
    return np.asarray(1 / (1 + error**2), np.float64)


def colour_distance(graph: Graph, pairs: Ints) -> Floats:
    """(n) distance in Lab of n pairs of superpixels (n, 2)."""
    lightness, a, b = (graph.colour[pairs[:, 0]] - graph.colour[pairs[:, 1]]).T
    return np.asarray(np.sqrt(lightness**2 + a**2 + b**2))
