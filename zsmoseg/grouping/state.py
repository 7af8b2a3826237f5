"""Whether an object moves at a frame, and by what margin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.evidence import PairEvidence
from zsmoseg.motion.models import Floats


def motion_state(
    pairs: list[PairEvidence],
    frames: int,
    group: NDArray[np.int64],
    threshold: float,
    s: settings.Groups,
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Moving (frames, N), and margin (frames, N) = ln(excess / threshold), NaN where unknown.

    The excess is the median over ``state_window`` pairs. A state changes to moving above ``state_high``
    thresholds, to resting below ``state_low``, else it stays; unseen pairs keep it. The last frame repeats the last
    pair. Objects of the static group never move; a mover without evidence of its own moves wherever it is.
    """
    excess = np.full((frames, len(group)), np.nan)
    for e in pairs:
        excess[e.pair, e.ids] = e.excess
    if frames > 1:
        excess[-1] = excess[-2]
    smooth = median_filter(excess, s.state_window)
    margin = (
        np.log(np.maximum(smooth, 1e-6) / threshold)
        if np.isfinite(threshold)
        else np.full_like(smooth, np.nan)
    )
    moving = np.zeros((frames, len(group)), np.bool_)
    for n in np.flatnonzero(group > 0):
        known = np.flatnonzero(np.isfinite(margin[:, n]))
        now = not len(known) or bool(margin[known[0], n] > 0)
        for t in range(frames):
            if np.isfinite(margin[t, n]):
                now = (
                    bool(margin[t, n] > np.log(s.state_low))
                    if now
                    else bool(margin[t, n] > np.log(s.state_high))
                )
            moving[t, n] = now
    return moving, margin.astype(np.float32)


def median_filter(values: Floats, window: int) -> Floats:
    """Median over ``window`` rows around each row, NaN = unknown."""
    half = window // 2
    out = np.full_like(values, np.nan)
    for t in range(len(values)):
        block = values[max(0, t - half) : t + half + 1]
        known = np.isfinite(block).any(0)
        out[t, known] = np.nanmedian(block[:, known], axis=0)
    return out
