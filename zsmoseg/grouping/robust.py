"""The geometry of two views that most points of an object follow."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from zsmoseg.grouping.twoview import Cue, distances
from zsmoseg.motion.models import Floats

NOISE = 0.5
"""px, standard deviation of a track's place: half of what flow resolves."""
LIMIT = 1.96 * NOISE
"""px beyond which a point does not follow a model (95 % of a normal error)."""
TRIALS, CONFIDENCE = 200, 0.99
"""Samples that the robust estimators draw at most, and the probability of the best that ends the search earlier."""
ESTIMATED: tuple[Literal["homography", "fundamental"], ...] = ("homography", "fundamental")
POINTS = 200
"""Points of an object that its model is fitted to at most, evenly chosen: the background needs no more."""
TRUNCATED = 2.0
"""Variances that an error counts at most in GRIC (Torr 1998: a point beyond is an outlier)."""
DIMENSIONS = 4
"""Of the data: two places of two coordinates."""
VARIANCES: dict[Cue, float] = {"fundamental": 1.0, "affine": 4.0, "homography": 8.0}
"""Of a point's place in the squared error of a point that follows a model: a fundamental matrix leaves one equation a
point, the maps two, seen in one frame or in both."""


def robust_model(first: Floats, second: Floats) -> tuple[Cue, Floats]:
    """Fundamental matrix of the points, or the homography or the shift where that explains them as well.

    Few points, a plane, a turning camera and small motion leave a fundamental matrix open; GRIC then prefers the
    model that such points determine (Torr, "An assessment of information criteria for motion model selection", CVPR
    1997; "Geometric motion segmentation and model selection", 1998).

    Parameters
    ----------
    first, second : (n, 2) px, at least 8.
    """
    some = np.linspace(0, len(first) - 1, min(len(first), POINTS)).astype(np.int64)
    a, b = first[some], second[some]
    shift = np.eye(3)
    shift[:2, 2] = np.median(b - a, axis=0)
    found: list[tuple[Cue, Floats]] = [("affine", shift)]
    for cue in ESTIMATED:
        model = estimated(cue, a, b)
        if model is not None:
            found.append((cue, model))
    return min(found, key=lambda entry: _gric(entry[0], entry[1], a, b))


def estimated(cue: Literal["homography", "fundamental"], first: Floats, second: Floats) -> Floats | None:
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

    Parameters
    ----------
    model : (3, 3).
    first, second : (n, 2) px.
    """
    error = distances(cue, model[None], first, second)[0]
    return np.asarray(error / VARIANCES[cue])


def _gric(cue: Cue, model: Floats, first: Floats, second: Floats) -> float:
    """Geometric robust information criterion (Torr, "Geometric motion segmentation and model selection", 1998).

    Truncated error, plus what the structure and the parameters of the model cost.
    """
    equations, parameters = {"fundamental": (1, 7), "homography": (2, 8), "affine": (2, 2)}[cue]
    error = np.minimum(model_errors(cue, model, first, second) / NOISE**2, TRUNCATED) * equations
    structure = np.log(float(DIMENSIONS)) * (DIMENSIONS - equations) * len(first)
    return float(error.sum() + structure + np.log(float(DIMENSIONS) * len(first)) * parameters)
