"""Whether an object moves at a frame, and by what margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.evidence import PairEvidence
from zsmoseg.motion.models import Floats

LEAST = 1e-6
"""px of excess that a logarithm is taken of at least."""


@dataclass(frozen=True)
class Hysteresis:
    """When a mover rests and when it moves again."""

    state_window: int
    """Pairs of the median of the excess."""
    state_low: float
    """Thresholds below which a mover rests."""
    state_high: float
    """Thresholds above which it moves again."""


def motion_state(
    pairs: list[PairEvidence],
    frames: int,
    group: NDArray[np.int64],
    threshold: Floats,
    parameters: Hysteresis,
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Whether each object moves (frames, N), and its margin (frames, N) = ln(excess / threshold), NaN where unknown.

    The excess is the median over ``state_window`` pairs. A state changes to moving above ``state_high``
    thresholds, to resting below ``state_low``, else it stays; unseen pairs keep it. The last frame repeats the last
    pair. Objects of the static group never move; a mover without evidence of its own moves wherever it is.

    Parameters
    ----------
    pairs : evidence of the pairs that have any.
    frames : frames of the shot.
    group : (N,) 0 = static.
    threshold : (N,) px, infinite where nothing moves.
    """
    excess = np.full((max(frames - 1, 1), len(group)), np.nan)
    for e in pairs:
        excess[e.pair, e.ids] = e.excess
    smooth = median_filter(excess, parameters.state_window)
    smooth = np.concatenate([smooth, smooth[-1:]])[:frames]
    margin = np.full(smooth.shape, np.nan)
    some = np.isfinite(threshold)
    margin[:, some] = np.log(np.maximum(smooth[:, some], LEAST) / threshold[some])
    moving = np.zeros(smooth.shape, np.bool_)
    low, high = np.log(parameters.state_low), np.log(parameters.state_high)
    for n in np.flatnonzero(group > 0):
        moving[:, n] = hysteresis(margin[:, n], low, high)
    return moving, margin.astype(np.float32)


def hysteresis(margin: Floats, low: float, high: float) -> NDArray[np.bool_]:
    """States (T,): on above ``high``, off below ``low``, else as before; the first value decides by its sign.

    Two thresholds, so that a value near one does not flicker: Canny, "A computational approach to edge detection",
    PAMI 1986.
    """
    known = margin[np.isfinite(margin)]
    now = not len(known) or bool(known[0] > 0)
    out = np.zeros(len(margin), np.bool_)
    for t, value in enumerate(margin):
        if np.isfinite(value):
            now = bool(value > (low if now else high))
        out[t] = now
    return out


def median_filter(values: Floats, window: int) -> Floats:
    """Median (T, N) over ``window`` rows around each row of (T, N), NaN = unknown."""
    half = window // 2
    out = np.full_like(values, np.nan)
    for t in range(len(values)):
        block = values[max(0, t - half) : t + half + 1]
        known = np.isfinite(block).any(0)
        out[t, known] = np.nanmedian(block[:, known], axis=0)
    return out
