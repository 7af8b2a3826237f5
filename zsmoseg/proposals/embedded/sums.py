"""Sums over the frames around each frame."""

from __future__ import annotations

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats


def sum_around(rows: Floats, radius: int) -> Floats:
    """Sums of the rows t - ``radius`` to t + ``radius`` of a table (frames, n), for each t."""
    sums, t = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, 0)]), np.arange(len(rows))
    return np.asarray(sums[np.minimum(t + radius + 1, len(rows))] - sums[np.maximum(t - radius, 0)])
