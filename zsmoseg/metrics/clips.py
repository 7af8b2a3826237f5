"""What a protocol is given of one sequence, and what it answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # the registry of protocols is read without numpy
    import numpy as np
    from numpy.typing import NDArray

Times = Mapping[int, Sequence[tuple[int, int]]]
"""Of each true object, the frame numbers ``start`` to ``stop`` (exclusive) between which it moves."""


class Frame(NamedTuple):
    """One frame that is scored.

    Attributes
    ----------
    where : names the prediction in messages.
    number : of the frame.
    truth, prediction : (H, W) integer labels, 0 = background; of track points there is no ``truth``.
    weight : (H, W) what each pixel counts; ``None`` for 1.
    """

    where: str
    number: int
    truth: NDArray[np.integer[Any]]
    prediction: NDArray[np.integer[Any]]
    weight: NDArray[np.float64] | None = None


class PointTracks(NamedTuple):
    """``points`` (tracks, frames, 2) x and y in pixels, ``visible`` (tracks, frames), ``label`` (tracks,) from 1."""

    points: NDArray[np.float64]
    visible: NDArray[np.bool_]
    label: NDArray[np.int64]


@dataclass(frozen=True)
class Clip:
    """One sequence of one prediction.

    Attributes
    ----------
    frames : those that are scored, in order, one in memory at a time.
    void : the true label that is void; ``None`` for none.
    official : give the official program's number also where that is known to be wrong.
    objects : how many objects the first annotated frame has, where the protocol counts them there.
    times : when each object moves, if known.
    tracks : labelled track points, where they are the truth.
    """

    frames: Iterable[Frame]
    void: int | None = None
    official: bool = False
    objects: int = 0
    times: Times | None = None
    tracks: PointTracks | None = None


@dataclass
class SequenceScore:
    """Scores of one sequence.

    Attributes
    ----------
    values : by metric, means over the sequence.
    count : how many objects the truth has.
    objects : the scores of each object, where the protocol has them.
    """

    values: dict[str, float]
    count: int
    objects: dict[int, dict[str, float]] = field(default_factory=dict)
