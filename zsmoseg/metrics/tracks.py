"""Pu, Ru, Fu: tracks over a whole sequence, matched one to one (Dave, Tokmakov, Ramanan 2019)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.metrics.counts import Labels, PairSums, PairTable, pair_counts

TINY = 1e-10
"""What the published evaluator puts in place of a denominator of 0."""


class TrackScores(NamedTuple):
    """Precision, recall and F of tracks, in percent; background is no track, surplus predictions count."""

    pu: float
    ru: float
    fu: float


class TrackMatch(NamedTuple):
    """The tracks of a sequence: labels, overlaps (truth, prediction), and who is matched with whom."""

    truth: NDArray[np.int64]
    prediction: NDArray[np.int64]
    overlap: NDArray[Any]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]

    def partners(self) -> dict[int, int]:
        """The predicted label of each true label that has one."""
        return dict(zip(self.truth[self.rows].tolist(), self.prediction[self.columns].tolist(), strict=True))


def track_scores(pairs: Iterable[tuple[Labels, Labels]]) -> TrackScores:
    """Pu, Ru, Fu of one sequence, frame by frame.

    Parameters
    ----------
    pairs : (truth, prediction) of every annotated frame, each (H, W) of integers or booleans, 0 = background.

    Notes
    -----
    Every label but 0 is a track, 255 and negative ones too. An empty truth or prediction gives 0.
    """
    sums = PairSums()
    for truth, prediction in pairs:
        sums.add(pair_counts(truth, prediction))
    return multi_label_scores(sums.table())


def match_tracks(table: PairTable) -> TrackMatch:
    """Match tracks by the largest sum of F.

    Notes
    -----
    The order of operations, of rows and of columns is that of the published evaluator, so that sums that
    are equal on paper break alike.
    """
    objects, tracks = table.truth != 0, table.prediction != 0
    overlap = table.pixels[np.ix_(objects, tracks)]
    precision = overlap / table.pixels.sum(0)[tracks]
    recall = overlap / table.pixels.sum(1)[objects][:, None]
    f = 2 * precision * recall / np.maximum(precision + recall, TINY)
    return TrackMatch(
        table.truth[objects], table.prediction[tracks], overlap, *scipy.optimize.linear_sum_assignment(-f)
    )


def multi_label_scores(table: PairTable) -> TrackScores:
    """Pu, Ru, Fu of the matched tracks."""
    match = match_tracks(table)
    return _scores(table, float(match.overlap[match.rows, match.columns].sum()))


def merged_scores(table: PairTable) -> TrackScores:
    """Pu, Ru, Fu with all true objects taken as one and all predictions as one: precision of pixels."""
    return _scores(table, float(table.pixels[np.ix_(table.truth != 0, table.prediction != 0)].sum()))


def _scores(table: PairTable, hit: float) -> TrackScores:
    p = 100.0 * hit / max(float(table.pixels[:, table.prediction != 0].sum()), TINY)
    r = 100.0 * hit / max(float(table.pixels[table.truth != 0].sum()), TINY)
    return TrackScores(p, r, 2 * p * r / max(p + r, TINY))
