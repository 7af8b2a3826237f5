"""Times of frames that can be believed, whatever a container says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

SHORTEST, LONGEST = 1e-3, 60.0
"""Seconds from one frame to the next, usually: what is beyond is an error of units."""
SLOWEST, FASTEST = 1, 240
"""Frames a second that a header may give where times do not count."""
USUAL = 0.04
"""Seconds from one frame to the next where nothing says: 25 a second."""


@dataclass
class Clock:
    """Times that are put right, and where."""

    times: list[float]
    """Seconds from the first frame, each later than the one before."""
    restarts: list[int] = field(default_factory=list)
    """Frames at which the clock started again or jumped."""
    unsaid: int = 0
    """Frames without a time, or with that of another."""
    believed: bool = True
    """Whether anything of what the container says was taken."""


def settle(said: Sequence[float | None], rate: Fraction | None, longest: float) -> Clock:
    """Times from what a container says.

    Parameters
    ----------
    said : seconds of each frame in the order shown; None where nothing is said.
    rate : frames a second by the header.
    longest : seconds from one frame to the next from which on it is the clock that jumped.

    Examples
    --------
    >>> settle([0, 1, 1, 3], None, 10).times
    [0.0, 1.0, 2.0, 3.0]
    >>> settle([5, 6, 7, 2, 3], None, 10)
    Clock(times=[0.0, 1.0, 2.0, 3.0, 4.0], restarts=[3], unsaid=0, believed=True)
    """
    step = _usual(said)
    if step is None:
        step = float(1 / rate) if rate and SLOWEST <= rate <= FASTEST else USUAL
        return Clock([n * step for n in range(len(said))], unsaid=len(said), believed=False)
    known = [(n, time) for n, time in enumerate(said) if time is not None]
    places, times, restarts, offset = [known[0][0]], [known[0][1]], [], 0.0
    for k, (n, time) in enumerate(known[1:], start=1):
        now, last = time + offset, times[-1]
        most = longest + step * (n - places[-1] - 1)  # one pause, however many frames between say nothing
        following, after = (
            (known[k + 1][0] - n, known[k + 1][1] + offset) if k + 1 < len(known) else (0, last)
        )
        fits = 0 < now - last <= most
        if (not fits or after < now) and 0 < after - last <= most + step * following:
            continue  # this time alone is wrong
        if not fits:
            if time == known[k - 1][1]:
                continue
            restarts.append(n)
            offset += last + step * (n - places[-1]) - now
        places.append(n)
        times.append(time + offset)
    whole = _between(len(said), places, times, step)
    return Clock([float(t) for t in whole - whole[0]], restarts, len(said) - len(places))


def _usual(said: Sequence[float | None]) -> float | None:
    """The usual distance of two frames; None where what is said makes no sense."""
    known = [(n, time) for n, time in enumerate(said) if time is not None]
    steps = [(b - a) / (j - i) for (i, a), (j, b) in pairwise(known) if b > a]
    step = float(np.median(steps)) if steps else 0.0
    return step if SHORTEST <= step <= LONGEST else None


def _between(count: int, places: Sequence[int], times: Sequence[float], step: float) -> NDArray[np.float64]:
    """Times of all frames from those at some places: even between them, the usual step beyond."""
    frames = np.arange(count)
    whole = np.interp(frames, places, times)
    beyond = np.minimum(frames - places[0], 0) + np.maximum(frames - places[-1], 0)
    return np.asarray(whole + step * beyond, np.float64)
