"""Misclassification of labelled track points: Hopkins155 (Tron, Vidal 2007), KT3DMoSeg (Xu, Cheong, Li 2018)."""

from __future__ import annotations

import numpy as np
import scipy

from zsmoseg.metrics.clips import Clip, SequenceScore
from zsmoseg.metrics.counts import Labels
from zsmoseg.metrics.votes import PointVotes


def classification_error(truth: Labels, prediction: Labels) -> float:
    """Points in the wrong group, in percent, under the one-to-one assignment of groups with the fewest.

    The background is a group like any other. Points of a predicted group beyond the number of true ones are wrong.

    Parameters
    ----------
    truth, prediction : (N,) group of each point, any integers; N at least 1.

    Examples
    --------
    >>> classification_error(np.array([1, 1, 1, 2]), np.array([7, 7, 5, 5]))
    25.0
    """
    if truth.shape != prediction.shape or truth.ndim != 1 or not truth.size:
        raise ValueError(f"labels of the same points expected, not of {truth.shape} and {prediction.shape}")
    true_ids, rows = np.unique(truth, return_inverse=True)
    predicted_ids, columns = np.unique(prediction, return_inverse=True)
    table = np.zeros((len(true_ids), len(predicted_ids)), np.int64)
    np.add.at(table, (rows, columns), 1)
    right = int(table[scipy.optimize.linear_sum_assignment(-table)].sum())
    return 100.0 * (truth.size - right) / truth.size


def score_tracks(clip: Clip) -> SequenceScore:
    """The error of the labels that the masks give the tracks of a clip; its frames are those of the tracks."""
    tracks = clip.tracks
    assert tracks is not None
    votes = PointVotes(tracks.points, tracks.visible)
    for index, frame in enumerate(clip.frames):
        votes.add(index, frame.prediction)
    error = classification_error(tracks.label, votes.labels())
    return SequenceScore({"error": error}, len(np.unique(tracks.label)))
