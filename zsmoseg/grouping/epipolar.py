"""Residuals of two-view geometry: objects under each other's models, as those of flow.

Each object's robust model on each other object's points, for frame pairs at several gaps. Over a gap parallax and
motion add up while the error of a track hardly grows, so motion stands out that one flow field hides.

Geometry: Hartley, Zisserman, "Multiple View Geometry in Computer Vision", 2004, chapters 9 to 11; robust fit: Raguram et
al., "USAC: a universal framework for random sample consensus", PAMI 2013, as implemented in OpenCV.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.trajectories import Tracks
from zsmoseg.grouping.robust import model_errors, robust_model
from zsmoseg.motion.models import Floats

LEAST_POINTS = 8
"""Tracks below which an object counts as unseen in a pair: what a fundamental matrix is fitted to linearly."""
TRIM = 0.8
"""Part of an object's points, the best, that its residual is the mean of: borders follow the neighbour."""


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


def _trimmed(error: Floats) -> float:
    """Mean of the best part."""
    return float(np.sort(error)[: max(int(TRIM * len(error)), 1)].mean())
