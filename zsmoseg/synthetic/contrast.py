"""Whether the objects of a scene can be told apart at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.grams import gram_matrices
from zsmoseg.motion.models import LEAST, MODELS, Floats, coordinates, normalise
from zsmoseg.motion.residuals import merge_costs

FASTEST = 60.0
"""px a frame that no flow scene exceeds."""


@dataclass(frozen=True)
class Played:
    """A scene as it is, before anything is measured with error; shapes as in ``Scene``."""

    labels: NDArray[np.uint16]
    flow: NDArray[np.floating]
    inverse_depth: NDArray[np.floating]
    group: NDArray[np.int64]
    moving: NDArray[np.bool_]


def contrast_of(scene: Played, least: float) -> tuple[Floats, bool]:
    """(N,) rms px against the background, and whether every mover is clear of it and of every other mover.

    Judged by the exact model, ``screw-shift``, on every second pixel of the exact data. All that does not
    move at a pair is the background.
    """
    n = len(scene.group)
    total, count = np.zeros((n, n)), np.zeros((n, n))
    height, width = scene.labels.shape[1:]
    x, y = (axis[::2] for axis in coordinates(height, width))
    for m, moving in enumerate(scene.moving):
        slot = np.where(moving[scene.labels[m]], scene.labels[m], 0)[::2, ::2].astype(np.int32)
        q = normalise(scene.inverse_depth[m][::2, ::2])
        gram = gram_matrices(slot, x, y, q, scene.flow[m, 0][::2, ::2], scene.flow[m, 1][::2, ::2], n)
        seen = np.flatnonzero(gram[:, 0, 0] >= LEAST)
        d, _ = merge_costs(gram[seen], MODELS["screw-shift"], gram.sum(0))
        total[np.ix_(seen, seen)] += d
        count[np.ix_(seen, seen)] += 1
    rms = np.sqrt(total / np.maximum(count, 1))
    movers = scene.group > 0
    resting = ~scene.moving.all(0)
    limit = np.where(resting, np.sqrt(0.5), 1.0)[:, None] * least
    other = movers[:, None] & ((scene.group[:, None] != scene.group) & movers | (np.arange(n) == 0))
    enough = count[0, movers] >= scene.moving[:, movers].sum(0) / 2
    speed = np.sqrt((scene.flow**2).sum(1)).max()
    return rms[0], bool((rms >= limit)[other].all() and enough.all() and speed < FASTEST)
