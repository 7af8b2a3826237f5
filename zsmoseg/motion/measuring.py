"""All that is measured on the pixels of one pair of frames; every stage behind reads only this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow
from zsmoseg.motion.models import Floats
from zsmoseg.motion.photometric import Image, unexplained, world_motion
from zsmoseg.motion.statistics import UNUSED, Sums, pair_sums, slots


@dataclass(frozen=True)
class PairMeasures:
    """What one pair says of S objects, the background first, and of the cells of the background."""

    gram: Floats
    """(S, 11, 11) Gram matrices; element [n, 0, 0] is a number of pixels."""
    cells: Floats
    """(cells, 11, 11)."""
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
    sums = pair_sums(slot, count, forward, backward, inverse_depth, ignore, parameters)
    gram, cells = sums[:count], sums[count:]
    if pictures is None:
        return PairMeasures(gram, cells, np.full((count, 2), np.nan))
    world = world_motion(gram[0], gram.sum(0))
    seen = slot if ignore is None else np.where(ignore, np.int32(UNUSED), slot)
    return PairMeasures(gram, cells, unexplained(*pictures, forward, world, seen, count))
