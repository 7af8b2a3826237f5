"""The label of a point track under masks: what most of the frames in which it is seen say."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.metrics.counts import Labels


class PointVotes:
    """Votes of the masks, frame by frame.

    Parameters
    ----------
    points : (tracks, frames, 2) x and y in pixels, the centre of the first pixel being (0, 0).
    visible : (tracks, frames).
    """

    def __init__(self, points: NDArray[np.floating[Any]], visible: NDArray[np.bool_]) -> None:
        self.points, self.visible = points, visible
        self._votes: list[Counter[int]] = [Counter() for _ in points]

    def add(self, frame: int, labels: Labels) -> None:
        """Look up the visible points of one frame in its (H, W) labels; points outside do not vote."""
        x, y = np.rint(self.points[:, frame]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < labels.shape[1]) & (y < labels.shape[0])
        for track in np.flatnonzero(self.visible[:, frame] & inside):
            self._votes[track][int(labels[y[track], x[track]])] += 1

    def labels(self) -> NDArray[np.int64]:
        """(tracks,) the most frequent label, the smaller of equals; 0 for a track without a vote."""
        chosen = [max(sorted(votes), key=votes.__getitem__, default=0) for votes in self._votes]
        return np.array(chosen, np.int64)
