"""Residuals of two-view geometry: points under random hypotheses, objects under each other's models.

``hypothesis_residuals``
    Rectangular: hypotheses of random minimal samples of the points; they belong to no object.
``epipolar_residuals``
    Square, as those of flow: each object's robust model on each other object's points, frame pairs at several gaps.
    Over a gap parallax and motion add up while the error of a track hardly grows, so motion stands out that one
    flow field hides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.trajectories import Tracks
from zsmoseg.grouping.twoview import SAMPLE, Cue, centred, distances, fit_samples
from zsmoseg.motion.models import Floats

LEAST_POINTS = 8
"""Tracks below which an object counts as unseen in a pair."""
NOISE = 0.5
"""px, standard deviation of a track's place: half of what flow resolves."""
LIMIT = 1.96 * NOISE
"""px beyond which a point does not follow a model (95 % of a normal error)."""
TRIM = 0.8
"""Part of an object's points, the best, that its residual is the mean of: borders follow the neighbour."""
TRIALS, CONFIDENCE = 200, 0.99
"""Samples that the robust estimators draw at most, and the probability of the best that ends the search earlier."""
ESTIMATED: tuple[Literal["homography", "fundamental"], ...] = ("homography", "fundamental")
POINTS = 200
"""Points of an object that its model is fitted to at most, evenly chosen: the background needs no more."""


def hypothesis_residuals(
    cue: Cue, first: Floats, second: Floats, count: int, seed: tuple[int, ...]
) -> Floats:
    """Squared distances (count, N) of point pairs from models of random samples of them.

    Parameters
    ----------
    first, second : (N, 2) the points in either frame, more than ``SAMPLE[cue]``; any unit.
    seed : numbers of the pair: the same samples whenever it is asked again.
    """
    a, b = centred(first.astype(np.float64)), centred(second.astype(np.float64))
    size = SAMPLE[cue]
    order = np.random.default_rng(seed).random((count, len(a)))
    sample = np.argpartition(order, size - 1, axis=1)[:, :size]
    return distances(cue, fit_samples(cue, a[sample], b[sample]), a, b)


@dataclass(frozen=True)
class EpipolarPair:
    """Residuals between the frames ``start`` and ``start + gap``."""

    start: int
    gap: int
    ids: NDArray[np.int64]
    """(slots,) objects seen in both, ascending."""
    residual: Floats
    """(slots, slots) row = model, column = points; px^2, NaN where either is unseen."""
    points: Floats
    """(slots,) number of tracks."""


def epipolar_residuals(
    tracks: Tracks, label: NDArray[np.int64], gaps: Sequence[int]
) -> Iterator[EpipolarPair]:
    """How well the two-view geometry of each object explains each other, for frame pairs at several gaps.

    Pairs of one gap follow each other without overlap, so each is evidence of its own; by gap, then by start.

    Parameters
    ----------
    tracks : of one shot.
    label : (rows,) object of each row of ``tracks``, 0 = background. A track counts for a pair if it is on the same
        object in both frames.
    gaps : frames between the two of a pair.
    """
    if not len(tracks.frame):
        return
    place = tracks.place.astype(np.float64)
    begin, end = int(tracks.frame[0]), int(tracks.frame[-1])
    for gap in gaps:
        for start in range(begin, end - gap + 1, gap):
            i, j = tracks.both(start, start + gap)
            same = label[i] == label[j]
            i, j = i[same], j[same]
            ids, slot = np.unique(label[i], return_inverse=True)
            if len(ids):
                residual, points = object_residuals(place[i], place[j], slot, len(ids))
                yield EpipolarPair(start, gap, ids, residual, points)


def object_residuals(
    first: Floats, second: Floats, slot: NDArray[np.int64], slots: int
) -> tuple[Floats, Floats]:
    """The residuals of one frame pair.

    Parameters
    ----------
    first, second : (rows, 2) px in either frame.
    slot : (rows,) 0 to slots - 1.

    Returns
    -------
    residual (slots, slots) : row = model, column = points; px^2 for each equation that a model sets, NaN where unseen.
    points (slots,)
    """
    points = np.bincount(slot, minlength=slots)
    seen = np.flatnonzero(points >= LEAST_POINTS)
    residual = np.full((slots, slots), np.nan)
    rows = [np.flatnonzero(slot == n) for n in seen]
    for i, own in zip(seen, rows, strict=True):
        cue, model = robust_model(first[own], second[own])
        error = model_errors(cue, model, first, second)
        residual[i, seen] = [_trimmed(error[r]) for r in rows]
    return residual, points.astype(np.float64)


def robust_model(first: Floats, second: Floats) -> tuple[Cue, Floats]:
    """Fundamental matrix of the points, or the homography or the shift where that explains them as well.

    Few points, a plane, a turning camera and small motion leave a fundamental matrix open; GRIC then prefers the
    model that such points determine (Torr, "An assessment of information criteria for motion model selection", CVPR
    1997).

    Parameters
    ----------
    first, second : (n, 2) px, at least ``LEAST_POINTS``.
    """
    some = np.linspace(0, len(first) - 1, min(len(first), POINTS)).astype(np.int64)
    a, b = first[some], second[some]
    shift = np.eye(3)
    shift[:2, 2] = np.median(b - a, axis=0)
    found: list[tuple[Cue, Floats]] = [("affine", shift)]
    for cue in ESTIMATED:
        model = _estimate(cue, a, b)
        if model is not None:
            found.append((cue, model))
    return min(found, key=lambda entry: _gric(entry[0], entry[1], a, b))


def _estimate(cue: Literal["homography", "fundamental"], first: Floats, second: Floats) -> Floats | None:
    """OpenCV's robust model; None where the points determine none."""
    cv2.setRNGSeed(0)
    how = cv2.USAC_MAGSAC
    try:
        if cue == "homography":
            model = cv2.findHomography(first, second, how, LIMIT, maxIters=TRIALS, confidence=CONFIDENCE)[0]
        else:
            model = cv2.findFundamentalMat(first, second, how, LIMIT, CONFIDENCE, TRIALS)[0]
    except cv2.error:  # what OpenCV 5 does with points of which no sample gives a model
        return None
    return None if model is None else np.asarray(model, np.float64)


def model_errors(cue: Cue, model: Floats, first: Floats, second: Floats) -> Floats:
    """Squared errors (n,), px^2, on one scale: the variance of a point's place is what each expects of its own points.

    A fundamental matrix leaves one equation a point, the maps two, seen in one frame or in both.
    """
    error = distances(cue, model[None], first, second)[0]
    return np.asarray(error / {"fundamental": 1.0, "affine": 4.0, "homography": 8.0}[cue])


def _gric(cue: Cue, model: Floats, first: Floats, second: Floats) -> float:
    """Torr's criterion: truncated error, plus what the structure and the parameters of the model cost."""
    equations, parameters = {"fundamental": (1, 7), "homography": (2, 8), "affine": (2, 2)}[cue]
    error = np.minimum(model_errors(cue, model, first, second) / NOISE**2, 2.0) * equations
    structure = np.log(4.0) * (4 - equations) * len(first)
    return float(error.sum() + structure + np.log(4.0 * len(first)) * parameters)


def _trimmed(error: Floats) -> float:
    """Mean of the best part."""
    return float(np.sort(error)[: max(int(TRIM * len(error)), 1)].mean())
