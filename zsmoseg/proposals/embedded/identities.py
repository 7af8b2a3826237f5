"""Ids for the foreground: one for each part, handed on from window to window by the frames they share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats, Ids, Ints
from zsmoseg.proposals.embedded.components import NONE


@dataclass
class Identities:
    """Names the parts of the windows of a shot, which must come in order."""

    ids: Ids = field(default_factory=lambda: np.zeros(0, np.int32))
    """(superpixels) object of each superpixel of the frames named last, 0 = none."""
    last: int = 0
    """Largest id given so far."""

    def name(self, part: Ints, size: Floats, known: int) -> Ids:
        """Objects of the next superpixels.

        A part takes the id that it shares the most pixels with where both are known; an id goes to one part only.
        Others get new ids, in the order in which they appear.

        Parameters
        ----------
        part, size
            (superpixels) part or ``NONE``, and px: of the last ``known`` superpixels that have been named, then of
            new ones.
        known
            How many of them have been named.

        Returns
        -------
        (superpixels - known) object, 0 = none.
        """
        before, then, now = self.ids[len(self.ids) - known :], part[:known], part[known:]
        given: dict[int, int] = {NONE: 0}
        for old, new in _by_overlap(before, then, size[:known]):
            if new not in given and old not in given.values():
                given[new] = old
        found, first = np.unique(now, return_index=True)
        for new in found[np.argsort(first)].tolist():
            if new not in given:
                self.last += 1
                given[new] = self.last
        name = np.array([given[new] for new in found.tolist()], np.int32)
        self.ids = np.concatenate([before, name[np.searchsorted(found, now)]])
        return self.ids[known:]


def _by_overlap(before: Ids, part: Ints, size: Floats) -> list[tuple[int, int]]:
    """Id and part of all that overlap, the largest overlap first."""
    both = (before > 0) & (part != NONE)
    pairs, row = np.unique(np.stack([before[both], part[both]], 1), axis=0, return_inverse=True)
    overlap = np.bincount(row.ravel(), size[both], len(pairs))
    order = np.lexsort((pairs[:, 1], pairs[:, 0], -overlap))
    return [(int(old), int(new)) for old, new in pairs[order]]
