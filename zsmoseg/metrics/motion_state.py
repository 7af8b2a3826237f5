"""Scores against motion times: is an object found while it moves, and what else is called moving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from zsmoseg.metrics.clips import Times
from zsmoseg.metrics.counts import PairCounts
from zsmoseg.metrics.regions import object_j


class MotionScores(NamedTuple):
    """J (percent) of objects while they move; predicted objects a frame that lie on nothing that moves."""

    j: float
    false_objects: float


def motion_scores(
    frames: Sequence[tuple[int, PairCounts]], partners: Mapping[int, int], times: Times
) -> MotionScores:
    """Score one sequence.

    Parameters
    ----------
    frames : frame number and pair counts of every annotated frame.
    partners : the predicted label of each true label, over the whole sequence; one without scores 0.
    times : when each object moves.

    Notes
    -----
    J is the mean over all frames at which an object moves and is visible; nan if there is none. A predicted
    object is false in a frame if less than half of its pixels lie on objects that move at that frame.
    """
    values, false = [], 0
    for number, counts in frames:
        moving = [o for o, spans in times.items() if any(start <= number < stop for start, stop in spans)]
        seen = [o for o in moving if o in counts.truth]
        values += [object_j(counts, o, partners[o]) if o in partners else 0.0 for o in seen]
        false += _false_objects(counts, seen)
    j = 100 * float(np.mean(values)) if values else float("nan")
    return MotionScores(j, false / len(frames) if frames else float("nan"))


def _false_objects(counts: PairCounts, moving: Sequence[int]) -> int:
    """Predicted objects of one frame of which less than half lies on the objects ``moving``."""
    on = np.isin(counts.truth, moving)
    labels = np.unique(counts.prediction[counts.prediction != 0])
    inside = [counts.pixels[on & (counts.prediction == n)].sum() for n in labels]
    areas = [counts.pixels[counts.prediction == n].sum() for n in labels]
    return sum(bool(2 * part < area) for part, area in zip(inside, areas, strict=True))
