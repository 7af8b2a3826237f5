"""What counts as full motion in a frame: motion has no scale of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Bools, Floats
from zsmoseg.proposals.embedded.graph import Graph


@dataclass(frozen=True, kw_only=True)
class FullMotion:
    """What counts as full motion."""

    top: float
    """Quantile of a frame's motion that is full motion."""
    top_window: int
    """Frames on both sides over whose full motion the median is taken."""
    top_least: float = 1.0
    """Full motion is never less: what is slower stays weak, px. Halved or doubled it changes J by 0.02 at most."""


def full(graph: Graph, x: Floats, among: Bools, motion: FullMotion) -> Floats:
    """(F) full motion of each frame, px, where ``x`` (superpixels) is motion, px: of those ``among`` which one looks."""
    looked = among & graph.has_flow
    high = np.array([_top(x[graph.of(t)][looked[graph.of(t)]], motion) for t in range(graph.frames)])
    radius = motion.top_window
    around = (high[max(0, t - radius) : t + radius + 1] for t in range(graph.frames))
    middle = np.array([np.median(part[~np.isnan(part)]) if (part > 0).any() else 0 for part in around])
    return np.asarray(np.maximum(middle, motion.top_least), np.float64)


def _top(x: Floats, motion: FullMotion) -> float:
    return float(np.quantile(x, motion.top)) if len(x) else np.nan


def against_full_motion(graph: Graph, x: Floats, among: Bools, motion: FullMotion) -> Floats:
    """(superpixels) ``x`` (superpixels), px, over the full motion of its frame, at most 1."""
    return np.minimum(x / full(graph, x, among, motion)[graph.frame], 1)
