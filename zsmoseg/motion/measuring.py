"""All that is measured on the pixels of one pair of frames; every stage behind reads only this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow
from zsmoseg.flow.noise import flow_noise
from zsmoseg.motion.models import Floats
from zsmoseg.motion.photometric import Image, unexplained, world_motion
from zsmoseg.motion.statistics import UNUSED, Sums, pair_sums, slots, used_slots


@dataclass(frozen=True)
class PairMeasures:
    """What one pair says of S objects, the background first."""

    gram: Floats
    """(S, 11, 11) Gram matrices; element [n, 0, 0] is a number of pixels."""
    noise: float
    """Variance of the flow's error on the background, px^2."""
    unexplained: Floats
    """(S, 2) what the world's motion leaves of the picture, and what the flow does, grey levels^2 x px; NaN without
    pictures."""


def measure_pair(
    label: NDArray[np.integer[Any]],
    ids: NDArray[np.int64],
    forward: Flow,
    backward: Flow | None,
    inverse_depth: NDArray[np.floating] | None,
    pictures: tuple[Image, Image] | None,
    ignore: NDArray[np.bool_] | None,
    parameters: Sums,
) -> PairMeasures:
    """Measure one pair.

    Parameters
    ----------
    label : (h, w) object of every pixel of the first frame on the working grid, 0 = background.
    ids : (S,) the objects asked for, ascending, 0 first.
    forward, backward : (2, h, w) px, x then y, NaN = unknown; backward None: forward is right everywhere.
    inverse_depth : (h, w) of the first frame, any positive scale; None: no depth.
    pictures : (h, w) each, both frames as ``photometric.grey`` gives them.
    ignore : (h, w) true where pixels count for nothing.
    """
    slot, count = slots(label, ids), len(ids)
    used = used_slots(slot, forward, backward, ignore, parameters)
    gram = pair_sums(used, count, forward, inverse_depth)
    noise = flow_noise(forward, used == 0, parameters.noise_lag)
    if pictures is None:
        return PairMeasures(gram, noise, np.full((count, 2), np.nan))
    world = world_motion(gram[0], gram.sum(0))
    seen = slot if ignore is None else np.where(ignore, np.int32(UNUSED), slot)
    return PairMeasures(gram, noise, unexplained(*pictures, forward, world, seen, count))
