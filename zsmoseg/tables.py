"""What the embedded default measures on the superpixels of a frame and between those of two frames.

Every number depends on one frame or one pair of frames only, so a video may be cut into chunks anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import kernels, settings
from zsmoseg.flow.pairs import STATES, PairState
from zsmoseg.superpixels import lab


@dataclass(frozen=True)
class ChunkTables:
    """The tables of F frames that follow each other and of P pairs: all that start in them, or all but the last.

    Ragged arrays hold the rows of all frames or pairs one after the other; those of the k-th are
    ``offset[k]:offset[k + 1]``. Superpixels are numbered within their frame.
    """

    node_offset: NDArray[np.int64]
    """(F + 1) into ``node``, and into ``forth``, which lacks the last frame where P = F - 1."""
    node: NDArray[np.float32]
    """(nodes, 11) size in px without ignored ones, mean y, x, L, a, b, pixels within 2 px of the frame's border,
    mean square of the detail, and of its slope (xx, xy, yy) per px; see ``detail``."""
    edge_offset: NDArray[np.int64]
    """(F + 1) into ``edge`` and ``boundary``."""
    edge: NDArray[np.uint16]
    """(edges, 2) superpixels of one frame that touch."""
    boundary: NDArray[np.int32]
    """(edges) length of their common boundary, px."""
    state: NDArray[np.uint8]
    """(P) index into ``STATES``; a cut has no links and zero flow."""
    forth: NDArray[np.float32]
    """(nodes, 4) of a pair's first frame: mean flow x, y and error forth and back, px; mean squared change of the
    detail along the flow."""
    back_offset: NDArray[np.int64]
    """(P + 1) into ``back``."""
    back: NDArray[np.float32]
    """(nodes, 4) the same of a pair's second frame, towards the first."""
    link_offset: NDArray[np.int64]
    """(P + 1) into ``link`` and ``carried``."""
    link: NDArray[np.uint16]
    """(links, 2) superpixel of the first frame, superpixel of the second."""
    carried: NDArray[np.int32]
    """(links, 2) pixels that the flow carries from one to the other, forth and back."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, for storage."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> ChunkTables:
        """From what ``arrays`` gave."""
        return cls(**{field.name: np.asarray(arrays[field.name]) for field in fields(cls)})

    @classmethod
    def join(cls, chunks: Sequence[ChunkTables]) -> ChunkTables:
        """Chunks that follow each other as one; all but the last must have P = F."""
        values: dict[str, NDArray[Any]] = {}
        for name in (field.name for field in fields(cls)):
            parts = [getattr(chunk, name) for chunk in chunks]
            if name.endswith("offset"):
                ends = np.cumsum([0, *(part[-1] for part in parts)])
                rest = [part[1:] + end for part, end in zip(parts, ends[:-1], strict=True)]
                values[name] = np.concatenate([parts[0][:1], *rest])
            else:
                values[name] = np.concatenate(parts)
        return cls(**values)

    def part(self, start: int, stop: int) -> ChunkTables:
        """Frames ``start`` to ``stop - 1``, counted from the first of these tables, and the pairs inside them."""
        pairs = max(min(stop - 1, len(self.state)), start)
        n, e, b, k = self.node_offset, self.edge_offset, self.back_offset, self.link_offset
        return ChunkTables(
            node_offset=n[start : stop + 1] - n[start],
            node=self.node[n[start] : n[stop]],
            edge_offset=e[start : stop + 1] - e[start],
            edge=self.edge[e[start] : e[stop]],
            boundary=self.boundary[e[start] : e[stop]],
            state=self.state[start:pairs],
            forth=self.forth[n[start] : n[pairs]],
            back_offset=b[start : pairs + 1] - b[start],
            back=self.back[b[start] : b[pairs]],
            link_offset=k[start : pairs + 1] - k[start],
            link=self.link[k[start] : k[pairs]],
            carried=self.carried[k[start] : k[pairs]],
        )


def chunk_tables(
    frames: NDArray[np.uint8],
    segments: NDArray[np.uint16],
    forward: NDArray[np.float32],
    backward: NDArray[np.float32],
    states: Sequence[PairState],
    length: int,
    ignore: NDArray[np.bool_] | None,
    s: settings.Tables,
) -> ChunkTables:
    """Measure the frames of a chunk and the pairs that start in them.

    Parameters
    ----------
    frames, segments
        (n, h, w, 3) and (n, h, w): the frames of the chunk and, where the video goes on, the one after them.
    forward, backward, states
        (n - 1, 2, h, w), (n - 1, 2, h, w) px and n - 1 states of their pairs.
    length
        Frames of the chunk: n, or n - 1 where the last one given belongs to the next chunk.
    ignore
        (h, w), true where pixels count for nothing: neither they nor their colours are in any table.
    s
        The section ``tables`` of the settings.
    """
    valid = np.ones(segments.shape[1:], np.bool_)
    if ignore is not None:
        valid = ~ignore
        frames = np.where(valid[..., None], frames, np.uint8(128))
    counts = [int(segment.max()) + 1 for segment in segments]
    details = [detail(frame) for frame in frames]
    node, edge, boundary = [], [], []
    for frame, segment, count, fine in zip(frames[:length], segments, counts, details, strict=False):
        nodes, first, second = kernels.measure_frame(segment, count, lab(frame), fine, slope(fine), valid)
        pairs, lengths = kernels.count_pairs(first, second, np.ones(len(first), np.int32), count, count)
        node.append(nodes)
        edge.append(pairs)
        boundary.append(lengths)
    forth, back, link, carried = [], [], [], []
    for m, state in enumerate(states):
        one = _Side(segments[m], counts[m], forward[m], details[m])
        two = _Side(segments[m + 1], counts[m + 1], backward[m], details[m + 1])
        there, back_again, links, pixels = _pair(one, two, state, valid, s.link_least)
        forth.append(there)
        back.append(back_again)
        link.append(links)
        carried.append(pixels)
    return ChunkTables(
        node_offset=_offsets(node),
        node=_stack(node, 11, np.float32),
        edge_offset=_offsets(edge),
        edge=_stack(edge, 2, np.uint16),
        boundary=np.concatenate(boundary).astype(np.int32),
        state=np.array([STATES.index(state) for state in states], np.uint8),
        forth=_stack(forth, 4, np.float32),
        back_offset=_offsets(back),
        back=_stack(back, 4, np.float32),
        link_offset=_offsets(link),
        link=_stack(link, 2, np.uint16),
        carried=_stack(carried, 2, np.int32),
    )


def detail(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w) grey level of a frame (h, w, 3) less its mean over 9 x 9 px, slightly smoothed."""
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey - cv2.blur(grey, (9, 9)), (3, 3), 0), np.float32)


def slope(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """(2, h, w) change of an image (h, w) per px in x and y."""
    return np.stack(
        [cv2.Sobel(image, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1))]
    )


def _offsets(parts: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    return np.cumsum([0, *map(len, parts)], dtype=np.int64)


def _stack(parts: Sequence[NDArray[Any]], columns: int, dtype: type) -> NDArray[Any]:
    return np.concatenate([np.zeros((0, columns), dtype), *parts]).astype(dtype)


@dataclass(frozen=True)
class _Side:
    """One frame of a pair: its superpixels, their number, the flow (2, h, w) to the other frame, the detail."""

    segment: NDArray[np.uint16]
    count: int
    flow: NDArray[np.float32]
    detail: NDArray[np.float32]


def _measure(one: _Side, two: _Side, valid: NDArray[np.bool_]) -> tuple[NDArray[Any], ...]:
    return kernels.measure_direction(  # type: ignore[no-any-return]
        one.segment, one.count, two.segment, one.flow, two.flow, one.detail, two.detail, valid
    )


def _pair(
    one: _Side, two: _Side, state: PairState, valid: NDArray[np.bool_], least: int
) -> tuple[NDArray[Any], ...]:
    """Both directions of one pair: statistics of either frame, links, and the pixels they carry."""
    if state == "cut":
        return (np.zeros((one.count, 4)), np.zeros((two.count, 4)), np.zeros((0, 2)), np.zeros((0, 2)))
    there, i, j, run = _measure(one, two, valid)
    back, k, h, run_back = _measure(two, one, valid)
    # forth and back are counted as one, a path back beyond the numbers of the second frame to tell them apart
    ends = np.r_[j, k + two.count]
    pairs, times = kernels.count_pairs(np.r_[i, h], ends, np.r_[run, run_back], one.count, 2 * two.count)
    backward = pairs[:, 1] >= two.count
    pairs[backward, 1] -= two.count
    key = pairs[:, 0] * two.count + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    new = np.r_[True, np.diff(key[order]) > 0]
    pixels = np.zeros((int(new.sum()), 2), np.int64)
    pixels[np.cumsum(new) - 1, backward[order].astype(np.int64)] = times[order]
    kept = pixels.sum(1) >= least
    return there, back, pairs[order][new][kept], pixels[kept]
