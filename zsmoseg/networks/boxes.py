"""Boxes: x0, y0, x1, y1, px."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Boxes = NDArray[np.float32]


def overlaps(one: NDArray[Any], others: NDArray[Any]) -> NDArray[np.float64]:
    """Intersection over union (n) of a box (4) with others (n, 4)."""
    low, high = np.maximum(one[:2], others[:, :2]), np.minimum(one[2:], others[:, 2:])
    both = np.prod(np.maximum(high - low, 0), 1, dtype=np.float64)
    area = np.prod(np.maximum(others[:, 2:] - others[:, :2], 0), 1, dtype=np.float64)
    own = float(np.prod(np.maximum(one[2:] - one[:2], 0), dtype=np.float64))
    return np.asarray(both / np.maximum(own + area - both, 1e-12))


def suppress(boxes: NDArray[Any], scores: NDArray[Any], overlap: float) -> NDArray[np.int64]:
    """Non-maximum suppression: the boxes (n, 4) that are kept, best first, whatever their category.

    Of equal scores the earlier one is kept, so that the result does not hang on how a library sorts.
    """
    left = np.argsort(-scores, kind="stable")
    kept = []
    while len(left):
        first, left = left[0], left[1:]
        kept.append(first)
        left = left[overlaps(boxes[first], boxes[left]) <= overlap]
    return np.array(kept, np.int64)
