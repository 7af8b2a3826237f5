"""Whether what moves goes on existing: flow that closes forward and backward belongs to objects that do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats
from zsmoseg.proposals.embedded.features_loops import ERROR
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.sums import sum_around

SALIENCY_LEAST, LEAST = 1e-6, 1e-9
"""Smallest saliency, and smallest of other numbers, that is divided by."""


@dataclass(frozen=True, kw_only=True)
class Cleanness:
    """How well flow must close."""

    clean_error: float
    """Error forward and backward, px per px of motion, at which it counts half as clean."""
    clean_pad: float = 0.5
    """Added to that motion, px. Halved or doubled it changes J by 0.1 at most."""


@dataclass(frozen=True)
class Persistence:
    """Where cleanness is demanded."""

    clean_top: float
    """Quantile of the cleanness of what moves that stands for the cleanest."""
    clean_from: float
    """Cleanest up to which no cleanness is demanded, 0 to 1."""
    clean_full: float
    """Cleanest from which all of it is demanded, 0 to 1."""
    clean_half: float
    """Share of the cleanest below which an object is unclean."""
    unclean_from: float
    """Unclean part of what moves up to which nothing is demanded."""
    unclean_full: float
    """Unclean part of what moves from which cleanness is demanded."""
    clean_power: float
    """Exponent of the demand."""


def cleanness(graph: Graph, speed: Floats, parameters: Cleanness) -> Floats:
    """(superpixels) 0 to 1: how well the flow closes, for the motion ``speed`` (superpixels), px, that there is."""
    error = np.minimum(graph.forward[:, ERROR], graph.backward[:, ERROR]) / (speed + parameters.clean_pad)
    return np.asarray(1 / (1 + (error / parameters.clean_error) ** 2))


def persistence(
    graph: Graph, x: Floats, clean: Floats, parameters: Persistence, window: int, bins: int
) -> Floats:
    """(superpixels) weight 0 to 1 of a saliency.

    Spray, waves and smoke form and dissolve, so their flow does not close; nor does that of thin and fast objects
    and of the rims of all objects. So this counts only where, over the frames around, something that moves is
    clean and most of what seems to move is not.

    Parameters
    ----------
    x, clean
        (superpixels) saliency, and what of it comes from flow that closes.
    window
        Frames looked at on both sides.
    bins
        Of the histogram of cleanness.
    """
    share = np.clip(clean / np.maximum(x, SALIENCY_LEAST), 0, 1)
    key = graph.frame * bins + np.minimum((share * bins).astype(np.int64), bins - 1)
    shape = graph.frames, bins
    count = np.bincount(key, graph.size * x**2, graph.frames * bins).reshape(shape).astype(np.float64)
    count = np.cumsum(sum_around(count, window), 1)
    total = count[:, -1:]
    # the middle of the bin in which the quantile falls
    cleanest = ((count < parameters.clean_top * total).sum(1) + 0.5) / bins
    half = np.minimum((cleanest * parameters.clean_half * bins).astype(np.int64), bins - 1)
    unclean = count[np.arange(graph.frames), half] / np.maximum(total[:, 0], LEAST)
    demand = _ramp(cleanest, parameters.clean_from, parameters.clean_full)
    demand = demand * _ramp(unclean, parameters.unclean_from, parameters.unclean_full)
    exponent = parameters.clean_power * demand[graph.frame]
    return np.asarray(np.minimum(share / cleanest[graph.frame], 1) ** exponent)


def _ramp(x: Floats, low: float, high: float) -> Floats:
    """0 below ``low``, 1 above ``high``, straight between."""
    return np.asarray(np.clip((x - low) / max(high - low, LEAST), 0, 1))
