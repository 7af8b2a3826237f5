"""The objects of a finished video, and the pieces that each was proposed in.

An object has the number of its largest piece, here and everywhere that a user sees: in ``objects/``, ``motion.csv``,
``summary.json``, ``zsmoseg explain``, exports and Python. What does not move is an object of one piece.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.groups import Groups

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Object:
    """An object: its number, its pieces, that of its number first, and where they are seen.

    Attributes
    ----------
    frames, frames_moving
        Frames in which any of the pieces is seen, and moves.
    area
        Pixels of all of them as displayed, all frames.
    """

    number: int
    pieces: Sequence[int]
    frames: int
    frames_moving: int
    area: int


def objects_of_pieces(groups: Groups) -> Ids:
    """(pieces,) the object that each is a piece of."""
    return np.where(groups.instance > 0, groups.instance, groups.object)


def objects(groups: Groups, labels: Labels) -> Iterator[Object]:
    """All objects that are seen, the background (0) first."""
    of = objects_of_pieces(groups)
    frames, frames_moving = _frames(of, groups, labels)
    for number in np.unique(of[groups.area > 0]):
        pieces = np.flatnonzero((of == number) & (groups.area > 0))
        others = [int(n) for n in pieces if n != number]
        yield Object(
            int(number),
            [int(number), *others],
            int(frames[number]),
            int(frames_moving[number]),
            int(groups.area[pieces].sum()),
        )


def _frames(of: Ids, groups: Groups, labels: Labels) -> tuple[Ids, Ids]:
    """(objects,) frames in which each is seen, and in which it moves."""
    frames, moving = np.zeros((2, len(of)), np.int64)
    for block in labels.blocks():
        frames += _any(of[block.object], block.area > 0, len(of))
    for state in groups.blocks():
        if state.has("moving"):
            moving += _any(of[state.object], state.moving, len(of))
    return frames, moving


def _any(of: Ids, piece: NDArray[np.bool_], count: int) -> Ids:
    """(objects,) frames in which any of the pieces (frames, pieces) of an object has it."""
    whole = np.zeros((count, len(piece)), np.bool_)
    np.logical_or.at(whole, of, piece.T)
    return np.asarray(whole.sum(1))
