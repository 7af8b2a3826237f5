"""Masks of some frames carried along the flow to others, and masks of single frames linked to objects."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Label = NDArray[np.uint16]
Flow = NDArray[np.float32]
Ids = NDArray[np.int64]
NOWHERE = -1e6


def here(height: int, width: int) -> Flow:
    """(2, h, w) the place of every pixel itself, x then y."""
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)))


def step(where: Flow, flow: Flow) -> Flow:
    """One frame further: where the pixels of this frame lie in the frame that masks are taken from.

    Parameters
    ----------
    where : (2, h, w) the same for the neighbour that ``flow`` leads to, x then y, px.
    flow : (2, h, w) from this frame to that neighbour, px; NaN = unknown, which lies nowhere.
    """
    x, y = np.nan_to_num(here(*flow.shape[1:]) + flow, nan=NOWHERE)
    return np.stack(
        [
            cv2.remap(w, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NOWHERE)
            for w in where
        ]
    )


def look_up(label: Label, where: Flow) -> Label:
    """The label (H, W) at the places ``where`` (2, h, w), px of a grid of any size; nowhere is 0."""
    (height, width), (h, w) = label.shape, where.shape[1:]
    scale = np.array([width / w, height / h], np.float32)[:, None, None]
    x, y = ((where + np.float32(0.5)) * scale - np.float32(0.5)).astype(np.float32)
    if (height, width) != (h, w):
        x, y = (cv2.resize(axis, (width, height), interpolation=cv2.INTER_LINEAR) for axis in (x, y))
    return np.asarray(
        cv2.remap(label, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    )


def nearest_known(known: NDArray[np.bool_], start: int, stop: int) -> NDArray[np.int64]:
    """For each of the frames ``start`` to ``stop - 1`` the nearest known one among them, the earlier of two; -1: none."""
    frames = np.arange(start, stop)
    some = frames[known[start:stop]]
    if not len(some):
        return np.full(len(frames), -1)
    return np.asarray(some[np.abs(frames[:, None] - some).argmin(1)])


@dataclass
class Linker:
    """Objects from masks of single frames: each mask takes the object whose mask, carried along the flow, it covers."""

    overlap: float
    """Intersection over union from which a mask is an object."""
    gap: int
    """Frames with masks that an object may be missing from."""
    last: int = 0
    """Number of the last object."""
    label: Label = field(default_factory=lambda: np.zeros((0, 0), np.uint16))
    """(h, w) the objects as last seen, carried to the present frame."""
    missed: dict[int, int] = field(default_factory=dict)
    """Frames in a row that each living object was missing from."""

    def start(self, shape: tuple[int, int]) -> None:
        """A new shot: nothing goes on."""
        self.label, self.missed = np.zeros(shape, np.uint16), {}

    def carry(self, backward: Flow) -> None:
        """To the next frame, along the flow (2, h, w) from that frame to this one."""
        self.label = look_up(self.label, step(here(*backward.shape[1:]), backward))

    def see(self, mask: Label, numbers: Ids) -> Ids:
        """The object of each of the masks ``numbers`` (K,), ascending, of a frame (h, w); new ones get new numbers."""
        table = np.zeros(max(int(mask.max(initial=0)), int(numbers.max(initial=0))) + 1, np.int64)
        table[numbers] = np.arange(1, len(numbers) + 1)
        place = table[mask]
        alive = np.array(sorted(self.missed), np.int64)
        objects = self._match(place, len(numbers), alive)
        fresh = objects == 0
        objects[fresh] = self.last + 1 + np.arange(int(fresh.sum()))
        self.last += int(fresh.sum())
        missed = {int(n): self.missed[int(n)] + 1 for n in alive if n not in objects}
        self.missed = {n: m for n, m in missed.items() if m <= self.gap} | dict.fromkeys(objects.tolist(), 0)
        kept = np.where(np.isin(self.label, list(self.missed)), self.label, 0)
        self.label = np.where(place > 0, np.append(0, objects)[place], kept).astype(np.uint16)
        return objects

    def _match(self, place: Ids, count: int, alive: Ids) -> Ids:
        """(count,) the living object of each mask, 0 = none: the assignment of the largest sum of overlaps."""
        column = np.zeros(self.last + 1, np.int64)
        column[alive] = np.arange(1, len(alive) + 1)
        code = place * (len(alive) + 1) + column[self.label]
        both = np.bincount(code.ravel(), minlength=(count + 1) * (len(alive) + 1)).reshape(count + 1, -1)
        union = both.sum(1)[1:, None] + both.sum(0)[None, 1:] - both[1:, 1:]
        share = both[1:, 1:] / np.maximum(union, 1)
        rows, columns = linear_sum_assignment(-share)
        objects = np.zeros(count, np.int64)
        good = share[rows, columns] >= self.overlap
        objects[rows[good]] = alive[columns[good]]
        return objects
