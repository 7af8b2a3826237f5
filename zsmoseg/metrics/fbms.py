"""P, R, F of the FBMS evaluator (Ochs, Malik, Brox 2014): regions, background included; surplus is free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.metrics.clips import Clip, SequenceScore
from zsmoseg.metrics.counts import PairSums, PairTable, frame_counts


class RegionScores(NamedTuple):
    """Precision, recall and F averaged over regions, in percent."""

    p: float
    r: float
    f: float


def region_scores(table: PairTable) -> RegionScores:
    """P, R, F of one sequence.

    Parameters
    ----------
    table : sums over the annotated frames, each pixel weighted by its probability where there is one.

    Notes
    -----
    Regions are matched to clusters by the Hungarian method (Kuhn 1955). Regions and clusters are the labels that occur with any weight, background (0) included. A region
    without a cluster counts P = 1, R = 0; a cluster without a region counts nothing.
    """
    pixels = table.pixels[np.ix_(table.pixels.sum(1) > 0, table.pixels.sum(0) > 0)]
    if not pixels.size:
        return RegionScores(0.0, 0.0, 0.0)
    precision, recall = pixels / pixels.sum(0), pixels / pixels.sum(1)[:, None]
    both = precision + recall
    f = 2 * precision * recall / np.where(both > 0, both, 1)
    match = scipy.optimize.linear_sum_assignment(-np.floor(10000 * f))
    unmatched = len(pixels) - len(match[0])
    p = float(precision[match].sum() + unmatched) / len(pixels)
    r = float(recall[match].sum()) / len(pixels)
    return RegionScores(100 * p, 100 * r, harmonic(100 * p, 100 * r))


def score_regions(clip: Clip) -> SequenceScore:
    """P, R, F of one sequence, pixels weighted by their probability where the truth has it."""
    sums = PairSums()
    for frame in clip.frames:
        sums.add(frame_counts(frame, clip.void))
    table = sums.table()
    scores = region_scores(table)
    return SequenceScore({"F": scores.f, "P": scores.p, "R": scores.r}, int((table.truth != 0).sum()))


def f_of_means(means: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """The means (...,) with F that of the mean P and the mean R, as the evaluator has it."""
    both = means["P"] + means["R"]
    return {**means, "F": 2 * means["P"] * means["R"] / np.where(both > 0, both, 1)}


def harmonic(p: float, r: float) -> float:
    """The harmonic mean; 0 where both are."""
    return 2 * p * r / (p + r) if p + r else 0.0
