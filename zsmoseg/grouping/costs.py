"""What it costs to give two objects one motion, over a shot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.evidence import Shot
from zsmoseg.motion.models import Floats, Model
from zsmoseg.motion.residuals import LEAST, merge_costs


@dataclass(frozen=True)
class Sameness:
    """What one motion for two may cost."""

    same: float
    """px that are allowed ..."""
    same_own: float
    """... plus this part of the objects' own residual: limbs are not rigid."""
    noise_area: float
    """px^2 over which the error of the flow is correlated."""


@dataclass(frozen=True)
class Costs:
    """(N, N) means over the pairs in which two objects are seen together."""

    together: Floats
    """px, rms cost of one motion for both; infinite where never together."""
    tolerance: Floats
    """px, what non-rigid parts of one body cost."""
    pairs: Floats
    """Number of such pairs."""


def pair_costs(shot: Shot, ids: NDArray[np.int64], count: int, model: Model, allowed: Sameness) -> Costs:
    """What one motion for two costs, for all pairs of the objects ``ids``, of ``count``.

    The yardstick is what each costs alone: limbs are not rigid, and neither is what flow makes of a body.
    """
    total, tolerance, weight, pairs = (np.zeros((count, count)) for _ in range(4))
    wanted = np.zeros(count, np.bool_)
    wanted[ids] = True
    for g in shot():
        here = np.flatnonzero(wanted[g.ids] & (g.pixels >= LEAST))
        if len(here) < 2:
            continue
        rows = np.append(0, here)  # the background, for its residual is the noise of the flow
        d, own = merge_costs(g.objects[rows], model, g.objects.sum(0))
        d, own, noise = d[1:, 1:], own[1:], own[0]
        pixels = g.pixels[here]
        small = np.minimum(pixels[:, None], pixels[None, :])
        both = own[:, None] + own[None, :]
        # P parameters less gain P A s2 / n by chance, as in the evidence; here of the two residuals' mean, by half
        chance = 0.5 * model.parameters * allowed.noise_area * np.minimum(both / 2, noise) / small
        at = np.ix_(g.ids[here], g.ids[here])
        total[at] += small * np.sqrt(np.maximum(d - chance, 0.0))
        tolerance[at] += small * (allowed.same + allowed.same_own * np.sqrt(both))
        weight[at] += small
        pairs[at] += 1
    known = weight > 0
    safe = np.where(known, weight, 1.0)
    return Costs(np.where(known, total / safe, np.inf), np.where(known, tolerance / safe, 1.0), pairs)
