"""The whole core on arrays in memory: labels and flow of a shot in, groups out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow
from zsmoseg.grouping.affinity import Kernel, ShotAffinity, shot_affinity
from zsmoseg.grouping.groups import Grouping, ShotGroups, group_shot
from zsmoseg.grouping.instances import end_velocities
from zsmoseg.grouping.pieces import measure_pieces
from zsmoseg.grouping.world import Pair
from zsmoseg.motion.measuring import measure_pair
from zsmoseg.motion.models import MODELS, Model
from zsmoseg.motion.residuals import pair_residuals
from zsmoseg.motion.statistics import Sums, mean_flow


@dataclass(frozen=True)
class Core:
    """Parameters of the core, each named after the section of the settings that it comes from."""

    statistics: Sums
    """Which pixels are summed."""
    affinity: Kernel
    """How residuals become agreement."""
    groups: Grouping
    """How objects are grouped."""


def shot_pairs(
    labels: NDArray[np.integer[Any]],
    flow: Flow,
    inverse_depth: NDArray[np.floating] | None,
    model: Model,
    sums: Sums,
    ignore: NDArray[np.bool_] | None = None,
    valid: NDArray[np.bool_] | None = None,
) -> list[Pair]:
    """The valid pairs measured; parameters as in ``group_arrays``."""
    ids = np.arange(int(labels.max(initial=0)) + 1, dtype=np.int64)
    out = []
    for m in range(len(flow)):
        if valid is None or valid[m]:
            depth = None if inverse_depth is None else inverse_depth[m]
            found = measure_pair(labels[m], ids, flow[m], None, depth, None, ignore, sums)
            out.append(Pair(m, ids, found.gram, found.noise, pair_residuals(found.gram, model)))
    return out


def group_arrays(
    labels: NDArray[np.integer[Any]],
    frames: NDArray[np.uint8],
    flow: Flow,
    inverse_depth: NDArray[np.floating] | None,
    model: str,
    core: Core,
    ignore: NDArray[np.bool_] | None = None,
    valid: NDArray[np.bool_] | None = None,
) -> tuple[ShotGroups, ShotAffinity]:
    """Statistics, residuals, affinity and groups of one shot.

    Parameters
    ----------
    labels : (T, h, w) object of every pixel, 0 = background, numbered without gaps.
    frames : (T, h, w, 3) blue green red.
    flow : (T - 1, 2, h, w) px, x then y, to the next frame.
    inverse_depth : (T, h, w) of any positive scale, or None.
    model : name of the motion model.
    ignore : (h, w) true where pixels count for nothing.
    valid : (T - 1,) false for pairs that are no pairs: a cut, a repeated frame.

    Returns
    -------
    ShotGroups, ShotAffinity
        Groups and instances by object, motion state by frame and object; the affinity and what lies beside it.
    """
    pairs = shot_pairs(labels, flow, inverse_depth, MODELS[model], core.statistics, ignore, valid)
    count = int(labels.max(initial=0)) + 1
    found = shot_affinity(lambda: iter(pairs), (len(flow), count), MODELS[model], core.affinity)
    pieces = measure_pieces(labels, frames, np.arange(count, dtype=np.int64))
    velocity = np.full((len(flow), count, 2), np.nan)
    for p in pairs:
        velocity[p.pair] = mean_flow(p.gram)
    whole = np.arange(pieces.area.shape[1])
    return group_shot(found, pieces, end_velocities(velocity), whole, labels.shape[1:], core.groups), found
