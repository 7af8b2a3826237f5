"""The score of one prediction on one sequence: reading both side by side, and checking that they fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from zsmoseg.datasets import Points, Truth
from zsmoseg.datasets.point_tracks import read_tracks
from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.metrics.clips import Clip, Frame, SequenceScore, Times
from zsmoseg.metrics.means import score_clip
from zsmoseg.metrics.protocols import Rules
from zsmoseg.workflows.evaluate.predictions import Prediction

WHITE = 255
"""What black and white masks hold where the object is."""


@dataclass(frozen=True)
class Job:
    """One sequence of one prediction."""

    prediction: Prediction
    truth: Truth | Points
    rules: Rules
    times: Times | None = None


@dataclass
class Scored:
    """Scores of a sequence and what a reader should know of it."""

    score: SequenceScore
    notes: list[str] = field(default_factory=list)


def score(job: Job) -> Scored:
    """Score one sequence."""
    truth, rules = job.truth, job.rules
    if isinstance(truth, Points):
        return Scored(score_clip(_points_clip(job, truth), rules.entry))
    counted = rules.entry.counted
    notes = [truth.note] if truth.note else []
    merge = (
        not rules.official
        and (counted or rules.void == WHITE or job.times is not None)
        and black_and_white(truth)
    )
    if merge:
        notes.append("the annotation is 0/255, read as one object")
    objects = 0 if not counted else 1 if merge else count_objects(truth, rules)
    clip = Clip(_frames(job, truth, merge), rules.void, rules.official, objects, job.times)
    return Scored(score_clip(clip, rules.entry), notes)


def black_and_white(truth: Truth) -> bool:
    """Whether the first annotation that is not empty holds 0 and 255 only: a mask, not ids with void."""
    found = (labels for index in range(len(truth.files)) if (labels := truth.labels(index)).any())
    first = next(found, None)
    return first is not None and not ((first != 0) & (first != WHITE)).any()


def count_objects(truth: Truth, rules: Rules) -> int:
    """How many objects a protocol of DAVIS 2017 scores: the highest id of the first annotated frame.

    Raises
    ------
    DatasetError
        None.
    """
    first = truth.labels(0)
    count = int(
        first.max(initial=0) if rules.void is None else first.max(initial=0, where=first != rules.void)
    )
    if count == 0:
        void = "" if rules.void is None else f" ({rules.void} is void)"
        if rules.official and black_and_white(truth):
            void = " (255 is void to the official program; leave out --official for 0/255 annotations)"
        raise DatasetError(
            f"{truth.file(0)}: has no object{void}, and {rules.protocol} scores the objects of the first annotated frame"
        )
    return count


def _frames(job: Job, truth: Truth, merge: bool) -> Iterator[Frame]:
    """The frames that are scored, one at a time, sizes checked; with ``merge`` all labels become 1."""
    protocol = job.rules.entry
    part = truth.scored(protocol.inner)
    size: tuple[int, ...] | None = None
    read = job.prediction.open(truth, protocol.inner)
    for index, number in enumerate(part.numbers):
        labels, (where, prediction) = part.labels(index), read(index)
        if size not in (None, labels.shape):
            raise DatasetError(
                f"{part.file(index)}: is {_words(labels.shape)}, the frames before it {_words(size)}"
            )
        size = labels.shape
        if prediction.shape != size:
            raise FormatError(
                f"{where}: is {_words(prediction.shape)}, the annotation {_words(size)}; masks must have the "
                "size of the annotation (enlarge them by nearest neighbour)"
            )
        if merge and ((labels != 0) & (labels != WHITE)).any():
            raise DatasetError(f"{part.file(index)}: holds ids, but the first annotation is a 0/255 mask")
        mask = (labels != 0).view(np.uint8) if merge else labels
        yield Frame(where, number, mask, prediction, part.weights(index) if protocol.weighted else None)


def _points_clip(job: Job, truth: Points) -> Clip:
    """Labelled tracks; the t-th mask in order of name belongs to the t-th column of them."""
    tracks = read_tracks(truth.path)
    count = tracks.points.shape[1]
    read, nothing = job.prediction.in_order(truth.name, count), np.zeros((0, 0), np.uint8)

    def frames() -> Iterator[Frame]:
        for index in range(count):
            where, prediction = read(index)
            yield Frame(where, index, nothing, prediction)

    return Clip(frames(), job.rules.void, job.rules.official, tracks=tracks)


def _words(shape: Sequence[int] | None) -> str:
    """A size as people say it: width x height."""
    return " x ".join(map(str, reversed(shape or ())))
