"""Candidates of a network for one frame: which of them become masks.

The rule of the paper (section 3.1): of two masks that overlap by more than half the weaker goes, and what covers more
than half of the image is no object. The thresholds are those of the networks' own demonstrations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

RANKS = 5
"""Categories of a candidate that are kept, the best first."""


@dataclass(frozen=True)
class Criteria:
    """What a candidate must be."""

    score: float
    """Best score of a category above which it counts."""
    quality: float
    """Predicted overlap with the truth above which the mask of a point counts."""
    stability: float
    """Area of its sure part over its possible part above which such a mask counts."""
    overlap: float
    """Intersection over union above which the weaker of two is the same again."""
    largest: float
    """Part of the image above which it is no object."""


def ranked(score: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The best categories (n, ``RANKS``) of scores (n, categories), and their scores; -1 and 0 where there are fewer."""
    best = np.argsort(-score, axis=1, kind="stable")[:, :RANKS]
    padding = ((0, 0), (0, RANKS - best.shape[1]))
    category = np.pad(best, padding, constant_values=-1).astype(np.int64)
    return category, np.pad(np.take_along_axis(score, best, 1), padding).astype(np.float32)


def chosen(
    score: NDArray[Any],
    quality: NDArray[Any],
    stability: NDArray[Any],
    area: NDArray[Any],
    overlap: NDArray[Any],
    image: int,
    criteria: Criteria,
) -> NDArray[np.int64]:
    """The candidates that become masks, best first.

    Parameters
    ----------
    score
        (n) of the best category.
    quality, stability
        (n) NaN where the masks are not those of a grid of points.
    area
        (n) px.
    overlap
        (n, n) intersection over union of the masks.
    image
        px of the image.
    """
    # comparisons with NaN are false: what has no quality is not measured by it
    weak = (quality <= criteria.quality) | (stability <= criteria.stability)
    good = (score > criteria.score) & ~weak & (area > 0) & (area <= criteria.largest * image)
    kept: list[int] = []
    for n in np.argsort(-score, kind="stable"):
        if good[n] and not (overlap[n, kept] > criteria.overlap).any():
            kept.append(int(n))
    return np.array(kept, np.int64)
