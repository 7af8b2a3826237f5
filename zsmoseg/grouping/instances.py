"""Objects that are one and the same instance: an id that broke and came back, a limb that came off.

Objects are near by place, time and colour; one goes on in another where it ends beside it in the open. The
decision is made on the objects; what joining adds is which of the movers are one instance, and which objects with too
little evidence of their own belong to an instance that moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.clustering import Labels
from zsmoseg.grouping.pieces import Pieces
from zsmoseg.motion.models import Floats

OPEN = 1.0
"""px to the border of the frame from which an object ends in the open: nearer, it may have left."""
TINY = 1e-9
"""Instead of 0 as divisor, px."""


@dataclass(frozen=True)
class Joining:
    """What may lie between two objects that are one instance."""

    reach: float
    """Sizes of the larger object, the root of its area, that their boxes may be apart."""
    gap: int
    """Frames that an instance may be out of sight."""
    colour: float
    """Intersection of colour histograms, 0 to 1, from which a gap is bridged."""
    overlap: float
    """Part of its life up to which an object may be seen beside the one it goes on in."""


ENDS = 3
"""Pairs at either end whose mean is a velocity."""


def end_velocities(velocity: Floats) -> Floats:
    """(2, N, 2) px a frame, of the first and of the last pairs of every object; 0 where it is never seen.

    Parameters
    ----------
    velocity : (M, N, 2) x, y px, mean flow of every pair; NaN = unseen.
    """
    out = np.zeros((2, *velocity.shape[1:]))
    for n in range(velocity.shape[1]):
        known = velocity[np.isfinite(velocity[:, n]).all(1), n]
        if len(known):
            out[:, n] = known[:ENDS].mean(0), known[-ENDS:].mean(0)
    return out


def box_gap(a: Floats, b: Floats) -> Floats:
    """Distance (...) between boxes (..., 4) of x0, y0, x1, y1, px; 0 where they overlap."""
    d = np.maximum(np.maximum(a[..., :2] - b[..., 2:], b[..., :2] - a[..., 2:]), 0.0)
    return np.hypot(d[..., 0], d[..., 1])


@dataclass(frozen=True)
class Nearness:
    """How far N objects are from being one instance."""

    distance: Floats
    """(N, N) in units of what is allowed, at most 1 = near; infinite = apart."""
    goes_on: NDArray[np.bool_]
    """(N, N) whether one goes on in the other."""


def nearness(
    pieces: Pieces,
    velocity: Floats,
    shape: tuple[int, ...],
    wanted: NDArray[np.int64],
    joining: Joining,
) -> Nearness:
    """Which of the objects ``wanted`` can be one instance.

    Seen together: the median distance of their boxes over the common frames. Never together: the earlier box
    moved on by its last velocity, or the later one back by its first, the better counts; at most ``gap`` frames
    apart, and over unseen frames the colours must agree. The unit is ``reach`` times the root of the larger
    area.

    Parameters
    ----------
    velocity : (2, N, 2) px a frame, of the first and of the last pairs of every object.
    shape : height and width of the working grid.
    wanted : objects, not the background.
    """
    count = pieces.area.shape[1]
    distance, goes_on = np.full((count, count), np.inf), np.zeros((count, count), np.bool_)
    lives = [_life(pieces, velocity, int(n)) for n in wanted if pieces.area[:, n].any()]
    lives.sort(key=lambda life: (life.first, life.number))
    for at, a in enumerate(lives):
        for b in lives[at + 1 :]:
            if b.first - a.last > joining.gap:
                break
            near = _together(a, b, shape, joining) if (a.seen & b.seen).any() else _apart(a, b, joining)
            for i, j in ((a.number, b.number), (b.number, a.number)):
                distance[i, j], goes_on[i, j] = near
    return Nearness(distance, goes_on)


@dataclass(frozen=True)
class _Life:
    """Where and when one object is seen: frames (T,), boxes (T, 4), colour shares, velocities (2, 4) of its ends."""

    number: int
    seen: NDArray[np.bool_]
    box: Floats
    size: float
    colour: Floats
    velocity: Floats

    @property
    def first(self) -> int:
        """First frame."""
        return int(self.seen.argmax())

    @property
    def last(self) -> int:
        """Last frame."""
        return len(self.seen) - 1 - int(self.seen[::-1].argmax())

    def alike(self, other: _Life, least: float) -> bool:
        """Whether the colour histograms intersect by ``least`` or more."""
        return bool(np.minimum(self.colour, other.colour).sum() >= least)

    def ends_beside(self, other: _Life, limit: float, shape: tuple[int, ...]) -> bool:
        """Whether this object ends or begins in the open beside the other."""
        border = np.array([shape[1] - OPEN, shape[0] - OPEN])
        for t, then in ((self.first, self.first - 1), (self.last, self.last + 1)):
            if 0 <= then < len(self.seen) and other.seen[then]:
                inside = (self.box[t, :2] > OPEN).all() and (self.box[t, 2:] < border).all()
                if inside and box_gap(self.box[t], other.box[then]) <= limit:
                    return True
        return False


def _life(pieces: Pieces, velocity: Floats, n: int) -> _Life:
    seen = pieces.area[:, n] > 0
    colour = pieces.colour[n] / max(int(pieces.colour[n].sum()), 1)
    size = float(np.sqrt(np.median(pieces.area[seen, n])))
    return _Life(n, seen, pieces.box[:, n].astype(np.float64), size, colour, np.tile(velocity[:, n], 2))


def _together(a: _Life, b: _Life, shape: tuple[int, ...], joining: Joining) -> tuple[float, bool]:
    """Distance of two objects seen together, and whether one goes on in the other."""
    common, limit = a.seen & b.seen, joining.reach * max(a.size, b.size)
    gap = float(np.median(box_gap(a.box[common], b.box[common])))
    short = common.sum() <= joining.overlap * min(a.seen.sum(), b.seen.sum())
    goes_on = (
        short
        and a.alike(b, joining.colour)
        and (a.ends_beside(b, limit, shape) or b.ends_beside(a, limit, shape))
    )
    return gap / max(limit, TINY), bool(goes_on)


def _apart(a: _Life, b: _Life, joining: Joining) -> tuple[float, bool]:
    """The same of two objects never seen together, ``a`` the earlier one."""
    frames, limit = b.first - a.last, joining.reach * max(a.size, b.size)
    if not 0 < frames <= joining.gap or (frames > 1 and not a.alike(b, joining.colour)):
        return np.inf, False
    end, start = a.box[a.last], b.box[b.first]
    onward = box_gap(end + frames * a.velocity[1], start)
    backdated = box_gap(end, start - frames * b.velocity[0])
    gap = min(float(onward), float(backdated))
    return gap / max(limit, TINY), gap <= limit


def movers_torn_from(group: Labels, whole: Labels, affinity: Floats, support: Floats) -> Labels:
    """For each static object (N,) the mover that it was torn off; itself where there is none.

    Proposals part what flow tells apart: two things that touch, and a limb from its body. Two things both move. What of a
    whole does not move apart from the world goes back to the larger mover in it, to that which it agrees with most; what
    agrees with the world entirely stays there, as what stands on the ground does.

    Parameters
    ----------
    group : (N,) 0 = static.
    whole : (N,) what the proposals hold together.
    affinity : (N, N), object 0 the world; NaN = unknown.
    support : (N,) pixels of every object, 0 for the background.
    """
    out = np.arange(len(group))
    for n in np.flatnonzero((group == 0) & (support > 0) & ~(affinity[0] >= 1)):
        movers = np.flatnonzero((group > 0) & (whole == whole[n]) & (support > support[n]))
        if len(movers):
            alike = np.nan_to_num(affinity[n, movers], nan=-1.0)
            out[n] = movers[np.lexsort((-support[movers], -alike))[0]]
    return out
