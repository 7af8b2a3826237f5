"""Whether flow leads back to where it began: the forward-backward check.

The closure error of a point p is ``f(p) + b(p + f(p))`` with the flow forward f and backward b. It is large where
the point is hidden in the other frame, where it leaves the frame, and where either flow is wrong. How much of it is
allowed grows with the motion: Sundaram, Brox, Keutzer, "Dense point trajectories by GPU-accelerated large
displacement optical flow", ECCV 2010.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

Flow = NDArray[np.float32]
Places = NDArray[np.float32]
FAR = 1e6
"""px, of the flow back from outside of the frame: no flow is as long, so nothing closes there."""


@dataclass(frozen=True)
class RoundTrip:
    """Points that went along the flow and back, in any arrangement (...)."""

    forward: Flow
    """(2, ...) x, y px: the flow of the points; NaN = unknown."""
    backward: Flow
    """(2, ...) x, y px: the flow back, from where they came to; bilinear."""
    end: Places
    """(2, ...) x, y px: where they came to."""
    shape: tuple[int, int]
    """Height and width of the frame."""

    @property
    def error(self) -> Flow:
        """(2, ...) px by which the points miss where they began."""
        return self.forward + self.backward

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(...) whether the points came to a place in the frame; false where that is unknown."""
        (x, y), (height, width) = self.end, self.shape
        return np.asarray((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))


@dataclass(frozen=True)
class Tolerance:
    """By how much points that went along the flow f and back along b may miss where they began."""

    absolute: float
    """px; px^2 for ``squares``."""
    relative: float
    """Part of the length of the flow, or of its square."""
    rule: Literal["sum", "larger", "squares"]
    """sum: absolute + relative |f|; larger: the larger of the two; squares: |error|^2 up to absolute + relative
    (|f|^2 + |b|^2)."""


def round_trip(forward: Flow, backward: Flow, scale: float = 1.0) -> RoundTrip:
    """Every pixel along the flow and back; outside of the frame the flow back is ``FAR``.

    Parameters
    ----------
    forward, backward : (2, h, w) in px of a grid that is ``scale`` times finer.
    """
    height, width = forward.shape[1:]
    x = np.arange(width, dtype=np.float32) + forward[0] / np.float32(scale)
    y = np.arange(height, dtype=np.float32)[:, None] + forward[1] / np.float32(scale)
    back = [cv2.remap(b, x, y, cv2.INTER_LINEAR, borderValue=FAR) for b in backward]
    return RoundTrip(forward, np.stack(back), np.stack([x, y]), (height, width))


def round_trip_of(place: Places, forward: Flow, backward: Flow) -> RoundTrip:
    """The same of points at ``place`` (2, n), x, y px, instead of pixels; at the border its nearest pixel counts."""
    height, width = forward.shape[1:]
    along = _between_pixels(forward, place)
    trip = RoundTrip(along, np.zeros_like(along), place + along, (height, width))
    back = _between_pixels(backward, np.where(trip.inside, trip.end, np.float32(0)))
    return RoundTrip(along, back, trip.end, trip.shape)


def _between_pixels(flow: Flow, place: Places) -> Flow:
    """(2, n) bilinear; NaN where a neighbour is."""
    return np.stack([scipy.ndimage.map_coordinates(f, place[::-1], order=1, mode="nearest") for f in flow])


def closed(trip: RoundTrip, tolerance: Tolerance) -> NDArray[np.bool_]:
    """(...) whether points come back to where they began; false where any of it is unknown."""
    f, absolute, relative = trip.forward, tolerance.absolute, tolerance.relative
    if tolerance.rule == "squares":
        allowed = relative * (_square(f) + _square(trip.backward)) + absolute
        return np.asarray(_square(trip.error) <= allowed)
    part = relative * _length(f)
    limit = absolute + part if tolerance.rule == "sum" else np.maximum(absolute, part)
    return np.asarray(_length(trip.error) <= limit)


def _length(vectors: Flow) -> NDArray[Any]:
    return cv2.magnitude(*vectors)


def _square(vectors: Flow) -> NDArray[Any]:
    return np.asarray(vectors[0] ** 2 + vectors[1] ** 2)
