"""What is known of the superpixels of some frames: as arrays, for the graph and for storage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.proposals.embedded.aliases import Ints


@dataclass(frozen=True)
class SuperpixelFeatures:
    """The superpixels of F frames that follow each other and of P pairs: all that start in them, or all but the last.

    Rows of all frames or pairs stand one after the other; how many each has is counted. Superpixels are numbered
    within their frame.
    """

    superpixels: NDArray[np.int64]
    """(F) superpixels of each frame."""
    feature: NDArray[np.float32]
    """(superpixels, 11) size in px without ignored ones; mean y, x in px; mean L, a, b; pixels within 2 px of the
    frame's border; mean square of the detail, and of its slope per px (xx, xy, yy), see ``detail``. The columns are
    ``features_loops.SIZE`` to ``YY``."""
    edges: NDArray[np.int64]
    """(F) edges of each frame."""
    edge: NDArray[np.uint16]
    """(edges, 2) superpixels of one frame that touch."""
    boundary: NDArray[np.int32]
    """(edges) length of their common boundary, px."""
    state: NDArray[np.uint8]
    """(P) index into ``zsmoseg.flow.pairs.STATES``; a cut has no links and zero flow."""
    forward: NDArray[np.float32]
    """(superpixels of the pairs' first frames, 4) mean flow x, y, px; mean error forward and backward, px; mean
    squared change of the detail along the flow; NaN where all of it is unknown. The columns are ``features_loops.U``
    to ``CHANGE``."""
    superpixels_after: NDArray[np.int64]
    """(P) superpixels of the second frame of each pair."""
    backward: NDArray[np.float32]
    """(superpixels of the pairs' second frames, 4) the same, towards the first frame."""
    links: NDArray[np.int64]
    """(P) links of each pair."""
    link: NDArray[np.uint16]
    """(links, 2) superpixel of the first frame, superpixel of the second."""
    carried: NDArray[np.int32]
    """(links, 2) pixels that the flow carries from one to the other, forward and backward."""

    @property
    def superpixel_offset(self) -> Ints:
        """(F + 1) first row of each frame in ``feature``, and in ``forward``."""
        return _offset(self.superpixels)

    @property
    def edge_offset(self) -> Ints:
        """(F + 1) first row of each frame in ``edge`` and ``boundary``."""
        return _offset(self.edges)

    @property
    def backward_offset(self) -> Ints:
        """(P + 1) first row of each pair in ``backward``."""
        return _offset(self.superpixels_after)

    @property
    def link_offset(self) -> Ints:
        """(P + 1) first row of each pair in ``link`` and ``carried``."""
        return _offset(self.links)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def join(cls, chunks: Sequence[SuperpixelFeatures]) -> SuperpixelFeatures:
        """Chunks that follow each other as one; all but the last must have P = F."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in names})

    def part(self, start: int, stop: int) -> SuperpixelFeatures:
        """Frames ``start`` to ``stop - 1``, counted from the first of these, and the pairs inside them."""
        pairs = max(min(stop - 1, len(self.state)), start)
        n, e, b, k = self.superpixel_offset, self.edge_offset, self.backward_offset, self.link_offset
        return SuperpixelFeatures(
            superpixels=self.superpixels[start:stop],
            feature=self.feature[n[start] : n[stop]],
            edges=self.edges[start:stop],
            edge=self.edge[e[start] : e[stop]],
            boundary=self.boundary[e[start] : e[stop]],
            state=self.state[start:pairs],
            forward=self.forward[n[start] : n[pairs]],
            superpixels_after=self.superpixels_after[start:pairs],
            backward=self.backward[b[start] : b[pairs]],
            links=self.links[start:pairs],
            link=self.link[k[start] : k[pairs]],
            carried=self.carried[k[start] : k[pairs]],
        )


def _offset(counts: Ints) -> Ints:
    return np.append(0, np.cumsum(counts, dtype=np.int64))
