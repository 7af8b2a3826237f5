"""Whether an object moves at a frame, and by what margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

LEAST = 1e-6
"""Odds that a logarithm is taken of at least."""


@dataclass(frozen=True)
class Hysteresis:
    """When a mover rests and when it moves again."""

    state_window: int
    """Pairs of the median of the odds."""
    state_low: float
    """Part of what it is held to below which a mover rests."""
    state_high: float
    """Times that, above which it moves again."""


def motion_state(
    odds: Floats, against: Floats, group: NDArray[np.int64], frames: int, parameters: Hysteresis
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Whether each object moves (frames, N), and its margin (frames, N), NaN where unknown.

    The margin is the logarithm of the odds against the static world, a median over ``state_window`` pairs, over what an
    object is held to: 1, the tolerance; a mover whose odds over the shot are below 1 (by a given number of groups,
    another rule, as a piece of an instance) is held to these. A state changes to moving above ``state_high``, to resting
    below ``state_low`` times that, else it stays; unseen pairs keep it. The last frame repeats the last pair. Objects of
    the static group never move; a mover without evidence of its own moves wherever it is.

    Parameters
    ----------
    odds : (M, N) excess over tolerance of every pair, NaN = unseen.
    against : (N,) odds over the shot, NaN = unknown.
    group : (N,) 0 = static.
    frames : frames of the shot, M + 1.
    """
    smooth = median_filter(odds, parameters.state_window) if len(odds) else np.full((1, len(group)), np.nan)
    smooth = np.concatenate([smooth, smooth[-1:]])[:frames]
    held = np.where((group > 0) & (against < 1), np.maximum(against, LEAST), 1.0)
    margin = np.log(np.maximum(smooth, LEAST) / held)
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
