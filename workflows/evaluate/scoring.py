"""The score of one prediction on one sequence: reading both side by side, and checking that they fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from zsmoseg.datasets import Points, Truth
from zsmoseg.datasets.points import read_tracks
from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.metrics.motion import Times
from zsmoseg.metrics.points import classification_error
from zsmoseg.metrics.protocols import PROTOCOLS, Rules, SequenceScore
from zsmoseg.metrics.scoring import (
    Frame,
    score_fbms,
    score_moving,
    score_objects,
    score_one_object,
    score_proposals,
)
from zsmoseg.metrics.votes import PointVotes
from zsmoseg.workflows.evaluate.predictions import Prediction

WHITE = 255
"""What black and white masks hold where the object is."""

SCORED_BY_ID = {"davis-2017": score_objects, "davis-2017-unsupervised": score_proposals}


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
        return Scored(_score_points(job, truth))
    notes = [truth.note] if truth.note else []
    by_id = rules.protocol in SCORED_BY_ID
    merge = (
        not rules.official
        and (by_id or rules.void == WHITE or job.times is not None)
        and black_and_white(truth)
    )
    if merge:
        notes.append("the annotation is 0/255, read as one object")
    frames = _frames(job, truth, merge)
    if by_id:
        return Scored(
            SCORED_BY_ID[rules.protocol](frames, 1 if merge else count_objects(truth, rules), rules), notes
        )
    if rules.protocol == "moving":
        return Scored(score_moving(frames, rules, job.times), notes)
    return Scored((score_fbms if rules.protocol == "fbms" else score_one_object)(frames, rules), notes)


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
    inner = PROTOCOLS[job.rules.protocol].inner
    part = truth.scored(inner)
    size: tuple[int, ...] | None = None
    with ExitStack() as stack:
        read = job.prediction.open(truth, inner, stack)
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
            weight = part.weights(index) if job.rules.protocol == "fbms" else None
            yield Frame(where, number, mask, prediction, weight)


def _score_points(job: Job, truth: Points) -> SequenceScore:
    """Labels at the track points; the t-th mask in order of name belongs to the t-th column of the tracks."""
    tracks = read_tracks(truth.path)
    votes = PointVotes(tracks.points, tracks.visible)
    with ExitStack() as stack:
        count = tracks.points.shape[1]
        read = job.prediction.in_order(truth.name, count, stack)
        for frame in range(count):
            votes.add(frame, read(frame)[1])
    groups = len(np.unique(tracks.label))
    return SequenceScore({"error": classification_error(tracks.label, votes.labels())}, groups)


def _words(shape: Sequence[int] | None) -> str:
    """A size as people say it: width x height."""
    return " x ".join(map(str, reversed(shape or ())))
