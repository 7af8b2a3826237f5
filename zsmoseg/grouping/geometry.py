"""Static things near the camera: they obey the geometry of the world, and stand on it.

Where the camera translates, what is near moves otherwise than the motion model of the background allows, and is proposed as
a mover. Over some frames the tracks of the background alone give the geometry of the world: a fundamental matrix, of it
rotation and direction of the camera (a pinhole whose focal length is the width of the frame), and of every track x -> y an
inverse depth, up to one scale and sign a pair:

    q = -(y x Rx) . (y x T) / |y x T|^2

An object obeys the world if its tracks lie on the world's epipolar lines and its foot is as near as the world right below it.
A mover along an epipolar line has some inverse depth too, but not that of the ground under it. Where a mover is half found, its
other half is what is seen below: so the world beside its foot counts too, and closer for what has far more parallax than the world.

Rotation, direction and depth of two views: Hartley, Zisserman, "Multiple View Geometry in Computer Vision", 2004, chapters
9.6 and 12; Sampson distance there, 11.4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Places
from zsmoseg.grouping.epipolar import LEAST_POINTS, TRIM
from zsmoseg.grouping.robust import POINTS, estimated
from zsmoseg.grouping.twoview import distances, homogeneous, sampson
from zsmoseg.motion.models import Floats

Ids = NDArray[np.int64]
Flags = NDArray[np.bool_]
Seen = tuple[Ids, Places, Ids]
"""Of one frame: the tracks (points,), where they are (points, 2) x, y px, and the objects that they are on (points,)."""
Measured = tuple[float, float, float, float]
"""Of an object in a pair: error, parallax, whether it stands: 1, 0, or NaN where no world is seen below, and how much nearer it
is than the world beside, NaN where none is seen."""
TwoViews = tuple[Floats, Floats, Ids, Flags]
"""Of two frames: where tracks are in either (rows, 2), the object that each is on (rows,), and whether in both."""

EVERY = 2
"""Frames from one that is looked at to the next."""
GAPS = (1, 2, 4)
"""Looks between the two of a pair, so 2, 4 and 8 frames: parallax adds up, the error of a track hardly grows."""
SPACING = 8
"""px at which tracks start: an object needs some 500 px to be measured."""
LEAST_WORLD = 40
"""Tracks of the world that a pair needs."""
PRECISION = 0.1
"""px, root mean square, that no track is better than: a world that strays less from its epipolar lines counts as if it did."""
FRONT = 0.9
"""Part of the world that is in front of the camera, if the world is one rigid scene; water is none."""
FOOT = 1.75
"""Ratio of inverse depths up to which an object stands on what is below it."""
LOWEST, BELOW, ASIDE, LEAST_BELOW = 0.3, 0.12, 4.0, 4
"""The foot of an object: its lowest tracks, part of them. The world below: so far below it, part of the height of the frame; so
far beside its foot, px; so many tracks at least."""
BESIDE = 4.0
"""Ratio of inverse depths up to which it fits to what is beside its foot: of what is found in part the foot is not the lowest."""
NEAREST, CLOSER = 3.0, 0.65
"""What exceeds ``Limits.parallax`` may do so up to so many times, and has that part of ``Limits.error`` and ``BESIDE``."""
OVER, UNDER, WIDE, NARROW = 0.02, 0.06, 2.0, 20.0
"""The world beside a foot: so far above and below its lowest track, parts of the height of the frame; so many widths of the foot to
its left and right, of at least so many px."""
TINY = 1e-12

VERDICTS = (
    "not asked",
    "obeys",
    "breaks",
    "shot too short",
    "world hidden",
    "too few tracks",
    "no world below",
    "no rigid world",
)
"""Not asked: nothing would move, or it is not to count. From the fourth on it cannot be known, and this is why."""
NOT_ASKED, OBEYS, BREAKS, TOO_SHORT, HIDDEN, FEW, NOTHING_BELOW, NOT_RIGID = range(len(VERDICTS))


@dataclass(frozen=True)
class Limits:
    """What an object that obeys the world may show."""

    error: float
    """Times the world's own distance from its epipolar lines."""
    parallax: float
    """Times the parallax that nine tenths of the world stay below, from which it has to fit closer."""


@dataclass(frozen=True)
class Geometry:
    """What the geometry of the world says of the N objects of a shot, object 0 first."""

    verdict: NDArray[np.int8]
    """(N,) one of ``VERDICTS`` by its place there."""
    counts: Flags
    """(N,) whose evidence of motion counts beside it."""
    front: float
    """Part of the world that is in front of the camera, median over the pairs of frames; NaN = unknown."""
    error: Floats
    """(N,) distance from the epipolar lines of the world over the world's own, median; NaN = unknown."""
    parallax: Floats
    """(N,) parallax over what nine tenths of the world stay below, median; NaN = unknown."""
    foot: Floats
    """(N,) part of the pairs in which its foot is as near as the world right below; NaN = unknown."""
    beside: Floats
    """(N,) inverse depth of its foot over that of the world beside it, median; NaN = unknown."""

    @classmethod
    def unasked(cls, count: int) -> Geometry:
        """Of a shot that was not looked at."""
        unknown = np.full((4, count), np.nan)
        return cls(np.zeros(count, np.int8), np.ones(count, np.bool_), np.nan, *unknown)

    @property
    def obeys(self) -> Flags:
        """(N,) what is static by the geometry of the world."""
        return np.equal(self.verdict, OBEYS)


def geometry_of(looks: Iterable[Seen], moving: Flags, size: tuple[int, int], limits: Limits) -> Geometry:
    """The verdict on each of N objects.

    Parameters
    ----------
    looks : every ``EVERY``-th frame of a shot, in order.
    moving : (N,) what would move.
    size : height and width of the frame, px.
    """
    front: list[float] = []
    seen: list[list[Measured]] = [[] for _ in moving]
    followed: list[list[Measured]] = [[] for _ in moving]
    unknown = TOO_SHORT
    for first, second, on, both in two_views(looks):
        world = World.of(first, second, np.flatnonzero(on == 0), size)
        unknown = HIDDEN if world is None and not front else FEW
        if world is not None:
            front.append(world.front)
            for n in np.flatnonzero(np.bincount(on) >= LEAST_POINTS):
                mine = np.flatnonzero((on == n) & both)
                if n > 0 and len(mine) >= LEAST_POINTS:
                    seen[n].append(world.measured(mine))
                elif n > 0:
                    followed[n].append(world.measured(np.flatnonzero(on == n)))
    whole = float(np.median(front)) if front else np.nan
    values = np.array([_of_pairs(pairs or brief) for pairs, brief in zip(seen, followed, strict=True)])
    verdict = np.array([_verdict(v, whole, unknown, limits) for v in values], np.int8)
    verdict[0] = NOT_ASKED
    return Geometry(verdict, _counting(verdict, moving), whole, *values.T)


def _counting(verdict: NDArray[np.int8], moving: Flags) -> Flags:
    """(N,) whose evidence of motion counts.

    Where something obeys that would move, what cannot be known is likely a scrap of it: it counts only beside a mover that
    breaks the geometry.
    """
    if not moving[verdict == OBEYS].any() or moving[verdict == BREAKS].any():
        return np.ones(len(verdict), np.bool_)
    return np.isin(verdict, (NOT_ASKED, OBEYS, BREAKS))


def two_views(looks: Iterable[Seen]) -> Iterator[TwoViews]:
    """The tracks of every pair of looks at the ``GAPS``; pairs of one gap follow each other without overlap.

    A track counts if it is on the same object in both, or on one that is not proposed in the other at all. By the latter what is
    proposed for a moment only is followed to the frames beside; what is seen longer does without, for tracks slide off it.
    """
    kept: deque[Seen] = deque(maxlen=max(GAPS) + 1)
    for t, look in enumerate(looks):
        kept.append(look)
        track, place, on = look
        for gap in GAPS:
            if t >= gap and t % gap == 0:
                before, where, was = kept[-1 - gap]
                _, i, j = np.intersect1d(before, track, assume_unique=True, return_indices=True)
                now, then = on[j], was[i]
                alike = (now == then) | ((then == 0) & ~np.isin(now, was)) | ((now == 0) & ~np.isin(then, on))
                i, j, now, then = i[alike], j[alike], now[alike], then[alike]
                yield (
                    where[i].astype(np.float64),
                    place[j].astype(np.float64),
                    np.maximum(now, then),
                    now == then,
                )


@dataclass(frozen=True)
class World:
    """The geometry of the world between two frames, and where all tracks lie in it."""

    place: Floats
    """(rows, 2) px in the first frame."""
    rows: Ids
    """Those of the world."""
    distance: Floats
    """(rows,) px^2 from the epipolar lines."""
    parallax: Floats
    """(rows,) px that the homography of the world leaves."""
    inverse: Floats
    """(rows,) inverse depth, up to scale; most of the world is positive."""
    height: int
    """px of the frame."""

    @classmethod
    def of(cls, first: Floats, second: Floats, rows: Ids, size: tuple[int, int]) -> World | None:
        """Fitted to the tracks ``rows``; None where they are few, or have no geometry."""
        if len(rows) < LEAST_WORLD:
            return None
        some = rows[np.linspace(0, len(rows) - 1, min(POINTS, len(rows))).astype(np.int64)]
        epipolar, plane = (estimated(cue, first[some], second[some]) for cue in ("fundamental", "homography"))
        if epipolar is None or plane is None:
            return None
        distance = sampson(epipolar[None], first, second)[0]
        parallax = np.sqrt(distances("affine", plane[None], first, second)[0])
        inverse = inverse_depth(epipolar, first, second, size)
        inverse *= _sign(inverse[rows])
        return cls(first, rows, distance, parallax, inverse, size[0])

    @property
    def front(self) -> float:
        """Part of the world that is in front of the camera."""
        return float((self.inverse[self.rows] > 0).mean())

    def measured(self, mine: Ids) -> Measured:
        """Of the object with the tracks ``mine``."""
        error = _spread(self.distance[mine]) / max(_spread(self.distance[self.rows]), PRECISION)
        most = max(float(np.quantile(self.parallax[self.rows], 0.9)), TINY)
        return error, float(np.median(self.parallax[mine])) / most, *self._stands(mine)

    def _stands(self, mine: Ids) -> tuple[float, float]:
        """Whether the foot is as near as the world right below, and how much nearer than the world beside."""
        x, y = self.place.T
        foot = mine[y[mine] >= np.quantile(y[mine], 1 - LOWEST)]
        left, right, lowest = x[foot].min() - ASIDE, x[foot].max() + ASIDE, y[mine].max()
        top, bottom = np.median(y[foot]), lowest + BELOW * self.height
        over, under = lowest - OVER * self.height, lowest + UNDER * self.height
        far = WIDE * max(right - left, NARROW)
        x, y = self.place[self.rows].T
        below = (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
        beside = (
            ((x < left) | (x > right)) & (x > left - far) & (x < right + far) & (y >= over) & (y <= under)
        )
        nearer = self._nearer(foot, self.rows[below])
        stands = float(1 / FOOT < nearer < FOOT) if np.isfinite(nearer) else np.nan
        return stands, self._nearer(foot, self.rows[beside])

    def _nearer(self, mine: Ids, others: Ids) -> float:
        """Inverse depth of some tracks over that of others; NaN where these are few."""
        if len(others) < LEAST_BELOW:
            return np.nan
        under = float(np.median(self.inverse[others]))
        return float(np.median(self.inverse[mine])) / (under if abs(under) > TINY else TINY)


def inverse_depth(epipolar: Floats, first: Floats, second: Floats, size: tuple[int, int]) -> Floats:
    """(rows,) inverse depths of tracks up to one scale and sign, for a pinhole whose focal length is the frame's width.

    Parameters
    ----------
    epipolar : (3, 3) fundamental matrix.
    first, second : (rows, 2) px.
    size : height and width of the frame, px.
    """
    height, width = size
    lens = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    turn, direction = _camera(lens.T @ epipolar @ lens)
    a, b = (homogeneous(p) @ np.linalg.inv(lens).T for p in (first, second))
    a = a @ turn.T
    across = np.cross(b, direction)
    return np.asarray(-(np.cross(b, a) * across).sum(1) / np.maximum((across**2).sum(1), TINY))


def _camera(essential: Floats) -> tuple[Floats, Floats]:
    """Rotation (3, 3), the smaller of the two that an essential matrix allows, and direction (3,)."""
    left, _, right = np.linalg.svd(essential)
    left, right = left * np.sign(np.linalg.det(left)), right * np.sign(np.linalg.det(right))
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    return max((left @ quarter @ right, left @ quarter.T @ right), key=np.trace), left[:, 2]


def _sign(inverse: Floats) -> float:
    """The sign of most inverse depths; what is very near counts no more than three times the middle."""
    middle = max(float(np.median(np.abs(inverse))), TINY)
    return 1.0 if float(np.clip(inverse / middle, -3, 3).sum()) >= 0 else -1.0


def _spread(square: Floats) -> float:
    """Root mean square of the best part: borders follow the neighbour."""
    return float(np.sqrt(np.sort(square)[: max(int(TRIM * len(square)), 1)].mean()))


def _of_pairs(found: list[Measured]) -> Measured:
    """Medians over the pairs, and the part of them in which it stands."""
    if not found:
        return (np.nan,) * 4
    error, parallax, *known = np.array(found).T
    foot, beside = (each[np.isfinite(each)] for each in known)
    return (
        float(np.median(error)),
        float(np.median(parallax)),
        float(foot.mean()) if len(foot) else np.nan,
        float(np.median(beside)) if len(beside) else np.nan,
    )


def _verdict(values: Floats, front: float, unknown: int, limits: Limits) -> int:
    """The verdict on one object by what was measured; ``unknown``: where it was not."""
    error, parallax, foot, beside = values
    if np.isnan(error):
        return unknown
    near = parallax > limits.parallax
    part = CLOSER if near else 1.0
    if error > part * limits.error or parallax > NEAREST * limits.parallax or foot < 0.5:
        return BREAKS
    if not np.isnan(beside) and not 1 / (part * BESIDE) < beside < part * BESIDE:
        return BREAKS
    if np.isnan(foot) or (near and np.isnan(beside)):
        return NOTHING_BELOW
    return OBEYS if front >= FRONT else NOT_RIGID
