"""In how many pairs each object is seen, and how it moves where it appears and where it disappears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.evidence import Shot
from zsmoseg.motion.models import Floats, U, V
from zsmoseg.motion.residuals import LEAST

ENDS = 3
"""Pairs at either end whose mean is a velocity."""


@dataclass(frozen=True)
class Sightings:
    """What linking needs of the Grams of N objects."""

    pairs: NDArray[np.int64]
    """(N,) pairs in which an object is seen."""
    velocity: Floats
    """(2, N, 2) x, y px a frame, of the first and of the last pairs."""


def sightings(shot: Shot, count: int) -> Sightings:
    """Sightings of ``count`` objects."""
    first: list[list[Floats]] = [[] for _ in range(count)]
    last: list[list[Floats]] = [[] for _ in range(count)]
    pairs = np.zeros(count, np.int64)
    for g in shot():
        for slot in np.flatnonzero(g.pixels >= LEAST):
            n = g.ids[slot]
            mean = g.objects[slot, 0, U : V + 1] / g.pixels[slot]
            if pairs[n] < ENDS:
                first[n].append(mean)
            last[n] = [*last[n], mean][-ENDS:]
            pairs[n] += 1
    means = [[np.mean(known, axis=0) if known else np.zeros(2) for known in end] for end in (first, last)]
    return Sightings(pairs, np.array(means))
