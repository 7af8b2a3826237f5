"""A tracker without a network: masks carried along the flow, and their border moved to where the colours change.

A pixel near the border of a carried mask is the object's where its colour says so more than its distance to the border
says otherwise. Colours are histograms of the object and of what lies around it in the frame of its start: Bibby, Reid,
"Robust real-time visual tracking using pixel-wise posteriors", ECCV 2008. Where the flow does not close (the
forward-backward check), the carried border is believed less.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Tolerance, closed, round_trip
from zsmoseg.tracking.carrying import Flow, Label, here, look_up, step
from zsmoseg.tracking.protocol import Frame, Step

Real = NDArray[np.float32]
Bins = NDArray[np.int64]
LEVELS = (8, 22, 22)
"""Bins of lightness, and of the two colour axes of Lab."""


@dataclass(frozen=True)
class Carrying:
    """How carried masks are corrected; px are those of the working grid."""

    softness: float = 0.6
    """px by which a border may be off for each unit of the logarithm of the ratio of colours."""
    doubt: float = 0.5
    """Factor of the distance to the border where the flow does not close."""
    tolerance: Tolerance = field(default_factory=lambda: Tolerance(0.5, 0.01, "squares"))
    """What closes: Sundaram, Brox, Keutzer, ECCV 2010."""
    around: float = 20.0
    """px around an object from which the colours beside it are taken."""
    smooth: float = 1.0
    """px, sigma, over which the colours of neighbours count together."""
    limit: float = 3.0
    """Largest logarithm of a ratio of colours."""
    ends: float = -1.0
    """Mean logarithm of the ratio over a carried mask below which it shows what was beside the object: it has ended."""


@dataclass
class FlowTracker:
    """See the file; its state is one label image and one histogram an object."""

    grid: tuple[int, int]
    """Height and width of the working grid, px."""
    carrying: Carrying = field(default_factory=Carrying)
    label: Label = field(default_factory=lambda: np.zeros((0, 0), np.uint16))
    """(H, W) the objects in the last frame."""
    colours: dict[int, Real] = field(default_factory=dict)
    """Of each object (bins), see ``ratio``."""

    def start(self, frame: Frame, label: Label) -> None:
        """Learn the colours of the objects; see ``Tracker``."""
        self.colours = {}
        self.add(frame, label)

    def add(self, frame: Frame, label: Label) -> None:
        """Learn the colours of those that are new; see ``Tracker``."""
        scale = frame.shape[1] / self.grid[1]
        self.label, bin_of = label, bins(frame, scale)
        there = set(np.unique(label[label > 0]).tolist())
        self.colours = {n: c for n, c in self.colours.items() if n in there}
        for n in sorted(there - set(self.colours)):
            mask = label == n
            near = ~mask & (signed_distance(mask) > -self.carrying.around * scale)
            self.colours[n] = ratio(bin_of, mask, near, self.carrying.limit)

    def step(self, step: Step) -> Label:
        """Carry the masks by one frame and correct their borders; see ``Tracker``. The flow must be there."""
        assert step.backward is not None
        assert step.forward is not None
        carried = look_up(self.label, _to(step.backward))
        closes = closed(round_trip(step.backward, step.forward), self.carrying.tolerance)
        trust = np.where(closes, np.float32(1), np.float32(self.carrying.doubt))
        size = step.frame.shape[1::-1]
        bin_of = bins(step.frame, size[0] / self.grid[1])
        self.label = self._corrected(carried, bin_of, np.asarray(cv2.resize(trust, size), np.float32))
        return self.label

    def _corrected(self, carried: Label, bin_of: Bins, trust: Real) -> Label:
        """(H, W) each pixel belongs to the object with the best score, if one is above 0."""
        c, scale = self.carrying, carried.shape[1] / self.grid[1]
        label, best = np.zeros_like(carried), np.zeros(carried.shape, np.float32)
        margin = int(np.ceil((c.softness * c.limit / c.doubt + 3 * c.smooth) * scale))
        for n, colour in self.colours.items():
            mask = carried == n
            if mask.any() and colour[bin_of[mask]].mean() >= c.ends:
                box = _box(mask, margin)
                looks = cv2.GaussianBlur(colour[bin_of[box]], (0, 0), c.smooth * scale)
                score = signed_distance(mask[box]) * trust[box] + np.float32(c.softness * scale) * looks
                wins = score > best[box]
                label[box][wins], best[box][wins] = n, score[wins]
        return label


def _to(backward: Flow) -> Flow:
    """(2, h, w) where the pixels of this frame lie in the frame before, px."""
    return step(here(*backward.shape[1:]), backward)


def _box(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The rows and columns of a mask, and some px around."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (
        slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + margin + 1),
        slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1),
    )


def bins(frame: Frame, scale: float) -> Bins:
    """(H, W) bin of the colour of every pixel; the frame is smoothed against noise by 0.75 px of the working grid.

    Parameters
    ----------
    frame
        (H, W, 3) blue green red.
    scale
        px of the frame in one px of the working grid.
    """
    lab = cv2.cvtColor(cv2.GaussianBlur(frame, (0, 0), 0.75 * scale), cv2.COLOR_BGR2LAB).astype(np.int64)
    place = lab * np.array(LEVELS) // 256
    return np.asarray((place[..., 0] * LEVELS[1] + place[..., 1]) * LEVELS[2] + place[..., 2])


def ratio(bin_of: Bins, inside: NDArray[np.bool_], near: NDArray[np.bool_], limit: float) -> Real:
    """(bins) logarithm of how much likelier a colour is inside than near, at most ``limit`` either way.

    Parameters
    ----------
    bin_of, inside, near
        (H, W) each.
    """
    size = int(np.prod(LEVELS))
    counts = [np.bincount(bin_of[where], minlength=size).reshape(LEVELS) for where in (inside, near)]
    smooth = [scipy.ndimage.gaussian_filter(c.astype(np.float64), (0.5, 1.0, 1.0)) for c in counts]
    one, two = (c / max(float(c.sum()), 1.0) + 1e-6 for c in smooth)
    return np.asarray(np.clip(np.log(one / two), -limit, limit), np.float32).ravel()


def signed_distance(mask: NDArray[np.bool_]) -> Real:
    """(H, W) px to the border of a mask (H, W), positive inside."""
    one = mask.astype(np.uint8)
    inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 3) for m in (one, 1 - one))
    return np.asarray(inside - outside, np.float32)
