"""The threshold of the saliency in each frame: where two classes part best and the boundary has contrast.

Source of the first: Otsu, "A threshold selection method from gray-level histograms", IEEE Trans. SMC 1979.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ints
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.sums import sum_around

TOP, TOP_LEAST = 0.99, 1e-6
"""Quantile of the saliency at which the levels end, as few values lie far above, and where they end at least."""
CLASS_LEAST = 0.002
"""Smallest foreground that a threshold may leave, share of all pixels: less is no class."""
SALIENCY_LEAST = 1e-4
"""Saliency below this is taken as this, for its logarithm."""
LEAST, VARIANCE_LEAST = 1e-9, 1e-12
"""Smallest sum and smallest variance that is divided by."""


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """What is contrast along a boundary."""

    contrast_colour: float
    """Colour distance that is 63 % of full contrast, Lab."""
    contrast_flow: float = 1.0
    """Flow distance that is 63 % of full contrast, px. Halved or doubled it changes J by 0.3 at most."""


@dataclass(frozen=True, kw_only=True)
class Threshold:
    """The choice of the threshold, and what it says."""

    window: int
    """Frames on both sides that are looked at."""
    threshold_bins: int = 64
    """Levels tried. Halved or doubled it changes J by 0.2 at most."""
    threshold_low: float
    """Smallest level tried, share of the top value."""
    threshold: float = 0.06
    """Smallest threshold, in saliency. Halved or doubled it changes J by nothing."""
    threshold_sure: float = 0.26
    """Threshold from which a frame's score is 1, in saliency. Halved or doubled it changes J by nothing."""
    softness: float
    """Softness of the foreground, in log(saliency / threshold)."""


def boundary_contrast(graph: Graph, contrast: Contrast) -> Floats:
    """(edges) 0 to 1: how much motion and colour both change."""
    colour = 1 - np.exp(-graph.edge_colour / contrast.contrast_colour)
    return np.asarray(colour * (1 - np.exp(-np.minimum(*graph.edge_flow) / contrast.contrast_flow)))


def thresholds(graph: Graph, x: Floats, contrast: Floats, among: Bools, parameters: Threshold) -> Floats:
    """(F) the threshold of each frame, over the frames around.

    Of ``threshold_bins`` levels the one with the largest product of the share of the variance that lies between
    the classes and of the mean contrast along the boundary between them.

    Parameters
    ----------
    x
        (superpixels) saliency.
    contrast
        (edges) as ``boundary_contrast`` gives it.
    among
        (superpixels) what is looked at.
    """
    bins = parameters.threshold_bins
    top = max(np.quantile(x[among], TOP), TOP_LEAST) if among.any() else TOP_LEAST
    level = np.clip((x / top * bins).astype(np.int64), 0, bins - 1)
    on = (graph.has_flow & among).astype(np.float64)
    pixels = _histogram(graph, np.arange(len(x)), level, graph.size * on, bins)
    between, enough = _otsu(sum_around(pixels, parameters.window))
    cut = _mean_contrast(graph, level, contrast, on, parameters)
    allowed = (np.arange(bins) / bins >= parameters.threshold_low) & enough
    best = np.where(allowed, between * cut, -1).argmax(1)
    return np.asarray(np.maximum((best + 1) / bins * top, parameters.threshold), np.float64)


def _histogram(graph: Graph, of: Ints, level: Ints, count: Floats, bins: int) -> Floats:
    """(F, bins) sums of ``count`` (n) by the frame of the superpixels ``of`` (n) and by ``level`` (n)."""
    summed = np.bincount(graph.frame[of] * bins + level, count, graph.frames * bins)
    return np.asarray(summed, np.float64).reshape(graph.frames, bins)


def _mean_contrast(graph: Graph, level: Ints, contrast: Floats, on: Floats, parameters: Threshold) -> Floats:
    """(F, bins) mean contrast of the edges from above each level to below it, weighted with their length.

    Parameters
    ----------
    level, on
        (superpixels) level of its saliency, and 1 or 0: whether it counts.
    """
    bins, (i, j) = parameters.threshold_bins, graph.edge.T
    low, high = np.minimum(level[i], level[j]), np.maximum(level[i], level[j])

    def along(count: Floats) -> Floats:
        count = count * on[i] * on[j]
        begun = _histogram(graph, i, low, count, bins) - _histogram(graph, i, high, count, bins)
        return sum_around(np.cumsum(begun, 1), parameters.window)

    return np.asarray(along(graph.boundary * contrast) / np.maximum(along(graph.boundary), LEAST))


def _otsu(count: Floats) -> tuple[Floats, Bools]:
    """For histograms (F, bins), cut above each bin: share of the variance between the classes, and whether two are."""
    bins = count.shape[1]
    centre = (np.arange(bins) + 0.5) / bins
    below, moment = np.cumsum(count, 1), np.cumsum(count * centre, 1)
    total = np.maximum(below[:, -1:], LEAST)
    mean, above = moment[:, -1:] / total, total - below
    variance = np.maximum((count * centre**2).sum(1, keepdims=True) / total - mean**2, VARIANCE_LEAST)
    between = (mean * below - moment) ** 2 / np.maximum(below * above, LEAST) / variance
    return between, above > CLASS_LEAST * total


def log_odds(graph: Graph, x: Floats, threshold: Floats, parameters: Threshold) -> Floats:
    """(superpixels) of being foreground, where ``x`` (superpixels) is saliency and ``threshold`` (F) that of its frame."""
    over = np.log(np.maximum(x, SALIENCY_LEAST) / threshold[graph.frame])
    return np.asarray(over / parameters.softness)


def probability(graph: Graph, x: Floats, threshold: Floats, parameters: Threshold) -> Floats:
    """(superpixels) 0 to 1: the same as ``log_odds``, as a probability."""
    return np.asarray(1 / (1 + np.exp(-log_odds(graph, x, threshold, parameters))))


def score(threshold: Floats, parameters: Threshold) -> Floats:
    """(F) 0: nothing moves by itself, to 1: something surely does, from the ``threshold`` (F) of the saliency."""
    least = parameters.threshold
    return np.clip((threshold - least) / (parameters.threshold_sure - least), 0, 1)
