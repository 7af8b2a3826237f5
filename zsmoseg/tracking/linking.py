"""Masks of single frames linked to objects."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from zsmoseg.tracking.carrying import Flow, Label, here, look_up, step
from zsmoseg.tracking.matching import matched, overlaps

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Linking:
    """When a mask is an object that is known."""

    overlap: float
    """Intersection over union with the propagated object from which a mask is that object."""
    gap: int
    """Frames with masks that an object may be missing from."""


@dataclass
class Linker:
    """Objects from masks of single frames: each mask takes the object whose mask, carried along the flow, it covers."""

    linking: Linking
    """When a mask is an object that is known."""
    last: int = 0
    """Number of the last object."""
    label: Label = field(default_factory=lambda: np.zeros((0, 0), np.uint16))
    """(h, w) the objects as last seen, carried to the present frame."""
    missed: dict[int, int] = field(default_factory=dict)
    """Frames in a row that each living object was missing from."""

    def start(self, shape: tuple[int, int]) -> None:
        """A new shot of frames of (height, width), px: nothing goes on."""
        self.label, self.missed = np.zeros(shape, np.uint16), {}

    def carry(self, backward: Flow) -> None:
        """To the next frame, along the flow (2, h, w) from that frame to this one, px."""
        self.label = look_up(self.label, step(here(*backward.shape[1:]), backward))

    def see(self, mask: Label, numbers: Ids) -> Ids:
        """The object of each mask of a frame; new ones get new numbers.

        Parameters
        ----------
        mask
            (h, w) number of the mask of each pixel, 0 = none.
        numbers
            (K) the masks, ascending; they may have gaps.

        Returns
        -------
        (K)
        """
        table = np.zeros(max(int(mask.max(initial=0)), int(numbers.max(initial=0))) + 1, np.int64)
        table[numbers] = np.arange(1, len(numbers) + 1)
        place = table[mask]
        alive = np.array(sorted(self.missed), np.int64)
        objects = self._match(place, len(numbers), alive)
        fresh = objects == 0
        objects[fresh] = self.last + 1 + np.arange(int(fresh.sum()))
        self.last += int(fresh.sum())
        missed = {int(n): self.missed[int(n)] + 1 for n in alive if n not in objects}
        self.missed = {n: m for n, m in missed.items() if m <= self.linking.gap}
        self.missed |= dict.fromkeys(objects.tolist(), 0)
        kept = np.where(np.isin(self.label, list(self.missed)), self.label, 0)
        self.label = np.where(place > 0, np.append(0, objects)[place], kept).astype(np.uint16)
        return objects

    def _match(self, place: Ids, count: int, alive: Ids) -> Ids:
        """The living object of each mask: the assignment of the largest sum of overlaps.

        Parameters
        ----------
        place
            (h, w) masks as 1 to ``count``, 0 = none.
        count
            Number of masks.
        alive
            (n) objects, ascending.

        Returns
        -------
        (count) object, 0 = none.
        """
        column = np.zeros(self.last + 1, np.int64)
        column[alive] = np.arange(1, len(alive) + 1)
        both, union = overlaps(place, column[self.label], count, len(alive))
        found = matched(both / np.maximum(union, 1), self.linking.overlap)
        return np.append(alive, 0)[found]
