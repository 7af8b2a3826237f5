"""How many pixels carry each pair of a true and a predicted label: all that the pixel scores need."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zsmoseg.metrics.clips import Frame

Labels = NDArray[np.integer[Any]]
Mask = NDArray[np.bool_]

DENSE = 1 << 18
"""Pairs up to which a histogram is faster than sorting the pixels."""


class PairCounts(NamedTuple):
    """The pairs that occur: true labels, predicted labels, pixels (or sums of weights), all (pairs,)."""

    truth: NDArray[np.int64]
    prediction: NDArray[np.int64]
    pixels: NDArray[Any]


class PairTable(NamedTuple):
    """True labels (rows) and predicted labels (columns), ascending, and the pixels of each pair."""

    truth: NDArray[np.int64]
    prediction: NDArray[np.int64]
    pixels: NDArray[Any]


def pair_counts(
    truth: Labels, prediction: Labels, weight: NDArray[np.floating[Any]] | None = None
) -> PairCounts:
    """Count the pairs of labels of one frame.

    Parameters
    ----------
    truth, prediction : integers of one shape, of any sign.
    weight : what each pixel counts instead of 1.
    """
    if truth.size == 0:
        return PairCounts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64))
    first, low = min(int(truth.min()), 0), min(int(prediction.min()), 0)
    height, width = int(truth.max()) - first + 1, int(prediction.max()) - low + 1
    code: NDArray[Any]
    if height * width <= 1 << 16 and first == low == 0:
        code = truth.ravel().astype(np.uint16) * np.uint16(width) + prediction.ravel().astype(np.uint16)
    else:
        code = (truth.ravel().astype(np.int64) - first) * width + (prediction.ravel().astype(np.int64) - low)
    weights = None if weight is None else weight.ravel()
    if height * width <= DENSE:
        counted = np.bincount(code)
        codes = np.flatnonzero(counted)
        pixels = counted[codes] if weights is None else np.bincount(code, weights)[codes]
    else:
        codes, place = np.unique(code, return_inverse=True)
        pixels = np.bincount(place, weights)
    return PairCounts(codes // width + first, codes % width + low, pixels)


def frame_counts(frame: Frame, void: int | None) -> PairCounts:
    """Pair counts of a frame outside the true label ``void``, by its weights if it has any."""
    if void is None:
        return pair_counts(frame.truth, frame.prediction, frame.weight)
    keep = frame.truth != void
    weight = None if frame.weight is None else frame.weight[keep]
    return pair_counts(frame.truth[keep], frame.prediction[keep], weight)


class PairSums:
    """Pair counts added up frame by frame; memory grows with the labels only."""

    def __init__(self) -> None:
        self._pixels: defaultdict[tuple[int, int], Any] = defaultdict(int)

    def add(self, counts: PairCounts) -> None:
        """Add one frame."""
        for truth, prediction, pixels in zip(*(column.tolist() for column in counts), strict=True):
            self._pixels[truth, prediction] += pixels

    def table(self) -> PairTable:
        """The sums as a matrix."""
        pairs = np.array(list(self._pixels), np.int64).reshape(-1, 2)
        rows, row = np.unique(pairs[:, 0], return_inverse=True)
        columns, column = np.unique(pairs[:, 1], return_inverse=True)
        values = np.array(list(self._pixels.values()))
        pixels = np.zeros((len(rows), len(columns)), values.dtype if len(values) else np.int64)
        pixels[row, column] = values
        return PairTable(rows, columns, pixels)
