"""The protocols of DAVIS on one sequence: 2016 (Perazzi et al.), 2017 (Pont-Tuset et al.), unsupervised (Caelles et al.)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.metrics.clips import Clip, Frame, SequenceScore
from zsmoseg.metrics.counts import Labels
from zsmoseg.metrics.davis import frame_scores, match_proposals, outside_void, statistics
from zsmoseg.metrics.protocols import DAVIS_METRICS, PROPOSALS


def score_one_object(clip: Clip) -> SequenceScore:
    """J and F of everything that is not background, as DAVIS 2016 scores."""
    series = []
    for frame in clip.frames:
        truth, prediction = outside_void(frame.truth, frame.prediction, clip.void)
        masks = (truth != 0).view(np.uint8), (prediction != 0).view(np.uint8)
        series.append(frame_scores(*masks, [(1, 1)]))
    j, f = np.array(series)[..., 0].T
    return SequenceScore(_values(j, f, clip.official), 1)


def score_objects(clip: Clip) -> SequenceScore:
    """J and F of each object under its own id, as the semi-supervised protocol of DAVIS 2017 scores.

    Raises
    ------
    FormatError
        An id above the number of objects.
    """
    series, pairs = [], [(n, n) for n in range(1, clip.objects + 1)]
    for frame in clip.frames:
        _refuse_ids(frame, clip.objects, f"the highest id of the truth is {clip.objects}")
        truth = frame.truth if clip.void is None else np.where(frame.truth == clip.void, 0, frame.truth)
        series.append(frame_scores(truth, frame.prediction, pairs))
    j, f = np.array(series).transpose(1, 2, 0)
    return _objects_score(j, f, clip.official)


def score_proposals(clip: Clip) -> SequenceScore:
    """J and F of each object's best proposal, as the unsupervised protocol of DAVIS 2017 scores.

    Raises
    ------
    FormatError
        More than 20 proposals.
    """

    def checked() -> Iterator[tuple[Labels, Labels]]:
        for frame in clip.frames:
            _refuse_ids(frame, PROPOSALS, f"the protocol allows {PROPOSALS} proposals")
            yield frame.truth, frame.prediction

    matched = match_proposals(checked(), clip.objects, clip.void)
    return _objects_score(matched.j, matched.f, clip.official)


def _objects_score(j: NDArray[np.float64], f: NDArray[np.float64], official: bool) -> SequenceScore:
    """From J and F (objects, frames)."""
    objects = {n: _values(*rows, official) for n, rows in enumerate(zip(j, f, strict=True), 1)}
    values = {name: float(np.mean([o[name] for o in objects.values()])) for name in DAVIS_METRICS}
    return SequenceScore(values, len(objects), objects)


def _values(j: NDArray[np.float64], f: NDArray[np.float64], official: bool) -> dict[str, float]:
    """The numbers of J and F (frames,)."""
    region, outline = statistics(j, official), statistics(f, official)
    return dict(zip(DAVIS_METRICS, ((region.mean + outline.mean) / 2, *region, *outline), strict=True))


def _refuse_ids(frame: Frame, highest: int, why: str) -> None:
    """Raise where a prediction has an id above ``highest``, or below 0."""
    low, high = int(frame.prediction.min()), int(frame.prediction.max())
    if high == 255 and not ((frame.prediction != 0) & (frame.prediction != 255)).any():
        raise FormatError(
            f"{frame.where}: is a 0/255 mask, which this protocol reads as object 255; save ids (1, 2, ...), or "
            "score it with --protocol davis-2016 or moving"
        )
    if high > highest or low < 0:
        raise FormatError(f"{frame.where}: has the id {high if high > highest else low}, but {why}")
