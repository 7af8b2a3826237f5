"""What is measured on the superpixels of a frame and between those of two frames.

Every number depends on one frame or one pair of frames only, so a video may be cut into chunks anywhere.

Mean products of the slope are the structure tensor: Förstner, Gülch, "A fast operator for detection and precise
location of distinct points", ISPRS 1987.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.pairs import STATES, PairState
from zsmoseg.proposals.embedded.adjacency_loops import boundary_steps, carried_runs, count_pairs
from zsmoseg.proposals.embedded.aliases import Bools, Floats, Frames, Ints, Segments, Singles
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.features_loops import FEATURES, FLOW_FEATURES, mean_features, mean_flow
from zsmoseg.proposals.embedded.superpixels import lab

IGNORED = np.uint8(128)
"""What ignored pixels are painted with, so that their colours leak through no blur: middle grey."""
SOBEL = 1 / 8
"""Makes the filter of Sobel, whose weights are 1, 2, 1 twice, a change per px."""
MEAN_SIDE = 9
"""Side of the window whose mean is taken off a grey level: larger than most texture, px."""


@dataclass(frozen=True, kw_only=True)
class Links:
    """Which superpixels of two frames are linked."""

    link_least: int = 2
    """Pixels that the flow must carry between two of them, forward and backward together. Halved or doubled it
    changes J by 0.1 at most."""


def measure(
    frames: Frames,
    segments: Segments,
    forward: Singles,
    backward: Singles,
    states: Sequence[PairState],
    length: int,
    ignore: Bools | None,
    links: Links,
) -> SuperpixelFeatures:
    """Measure the frames of a chunk and the pairs that start in them.

    Parameters
    ----------
    frames, segments
        (n, h, w, 3) and (n, h, w): the frames of the chunk and, where the video goes on, the one after them.
    forward, backward, states
        (n - 1, 2, h, w), (n - 1, 2, h, w) px, NaN = unknown, and n - 1 states of their pairs.
    length
        Frames of the chunk: n, or n - 1 where the last one given belongs to the next chunk.
    ignore
        (h, w), true where pixels count for nothing: neither they nor their colours are in any number.
    links
        Which superpixels are linked.
    """
    valid = np.ones(segments.shape[1:], np.bool_)
    if ignore is not None:
        valid = ~ignore
        frames = np.where(valid[..., None], frames, IGNORED)
    counts = [int(segment.max()) + 1 for segment in segments]
    details = [detail(frame) for frame in frames]
    alone = [_frame(frames[t], segments[t], counts[t], details[t], valid) for t in range(length)]
    pairs = []
    for m, state in enumerate(states):
        one = _Side(segments[m], counts[m], forward[m], details[m])
        two = _Side(segments[m + 1], counts[m + 1], backward[m], details[m + 1])
        pairs.append(_pair(one, two, state, valid, links.link_least))
    return _stacked(alone, pairs, states)


class _Frame(NamedTuple):
    """What is measured on one frame, as in ``SuperpixelFeatures``."""

    feature: Floats
    edge: Ints
    boundary: Ints


class _Pair(NamedTuple):
    """What is measured between two frames, as in ``SuperpixelFeatures``."""

    forward: Floats
    backward: Floats
    link: Ints
    carried: Ints


def _stacked(frames: list[_Frame], pairs: list[_Pair], states: Sequence[PairState]) -> SuperpixelFeatures:
    return SuperpixelFeatures(
        superpixels=_counts([frame.feature for frame in frames]),
        feature=_stack([frame.feature for frame in frames], FEATURES, np.float32),
        edges=_counts([frame.edge for frame in frames]),
        edge=_stack([frame.edge for frame in frames], 2, np.uint16),
        boundary=np.concatenate([frame.boundary for frame in frames]).astype(np.int32),
        state=np.array([STATES.index(state) for state in states], np.uint8),
        forward=_stack([pair.forward for pair in pairs], FLOW_FEATURES, np.float32),
        superpixels_after=_counts([pair.backward for pair in pairs]),
        backward=_stack([pair.backward for pair in pairs], FLOW_FEATURES, np.float32),
        links=_counts([pair.link for pair in pairs]),
        link=_stack([pair.link for pair in pairs], 2, np.uint16),
        carried=_stack([pair.carried for pair in pairs], 2, np.int32),
    )


def _counts(parts: Sequence[NDArray[Any]]) -> Ints:
    return np.array([len(part) for part in parts], np.int64)


def _stack(parts: Sequence[NDArray[Any]], columns: int, dtype: type) -> NDArray[Any]:
    return np.concatenate([np.zeros((0, columns), dtype), *parts]).astype(dtype)


def detail(frame: Frames) -> Singles:
    """(h, w) grey level of a frame (h, w, 3) less its mean over 9 x 9 px, slightly smoothed."""
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32)
    mean = cv2.blur(grey, (MEAN_SIDE, MEAN_SIDE))
    return np.asarray(cv2.GaussianBlur(grey - mean, (3, 3), 0), np.float32)


def slope(image: Singles) -> Singles:
    """(2, h, w) change of an image (h, w) per px in x and y."""
    return np.stack(
        [cv2.Sobel(image, cv2.CV_32F, *order, ksize=3, scale=SOBEL) for order in ((1, 0), (0, 1))]
    )


def _frame(frame: Frames, segment: Segments, count: int, fine: Singles, valid: Bools) -> _Frame:
    """Superpixels of a frame (h, w, 3) with detail ``fine`` (h, w), and which of them touch."""
    feature = mean_features(segment, count, lab(frame), fine, slope(fine), valid)
    first, second = boundary_steps(segment, valid)
    return _Frame(feature, *count_pairs(first, second, np.ones(len(first), np.int32), count, count))


@dataclass(frozen=True)
class _Side:
    """One frame of a pair: its superpixels, their number, the flow (2, h, w) to the other frame, the detail."""

    segment: Segments
    count: int
    flow: Singles
    detail: Singles

    def mean_flow(self, other: _Side, valid: Bools) -> Floats:
        """(superpixels, 4) of the flow to the ``other`` side."""
        return mean_flow(self.segment, self.count, self.flow, other.flow, self.detail, other.detail, valid)


def _pair(one: _Side, two: _Side, state: PairState, valid: Bools, least: int) -> _Pair:
    """Flow of either frame, links, and the pixels they carry."""
    if state == "cut":
        flows = np.zeros((one.count, FLOW_FEATURES)), np.zeros((two.count, FLOW_FEATURES))
        return _Pair(*flows, np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64))
    i, j, run = carried_runs(one.segment, two.segment, one.flow, valid)
    k, h, run_back = carried_runs(two.segment, one.segment, two.flow, valid)
    # both directions are counted as one; a way back ends beyond the numbers of the second frame, to tell them apart
    ends = np.r_[j, k + two.count]
    pairs, times = count_pairs(np.r_[i, h], ends, np.r_[run, run_back], one.count, 2 * two.count)
    backward = pairs[:, 1] >= two.count
    pairs[backward, 1] -= two.count
    key = pairs[:, 0] * two.count + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    new = np.diff(key[order], prepend=-1) > 0
    carried = np.zeros((int(new.sum()), 2), np.int64)
    carried[np.cumsum(new) - 1, backward[order].astype(np.int64)] = times[order]
    kept = carried.sum(1) >= least
    return _Pair(one.mean_flow(two, valid), two.mean_flow(one, valid), pairs[order][new][kept], carried[kept])
