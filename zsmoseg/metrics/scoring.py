"""One sequence under a protocol: frames in, numbers out; one frame in memory at a time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.metrics.counts import Labels, PairCounts, PairSums, pair_counts
from zsmoseg.metrics.davis import PROPOSALS, frame_scores, match_proposals, outside_void, statistics
from zsmoseg.metrics.fbms import region_scores
from zsmoseg.metrics.motion import Times, motion_scores
from zsmoseg.metrics.protocols import DAVIS_METRICS, MOTION_METRICS, Rules, SequenceScore
from zsmoseg.metrics.regions import merged_j
from zsmoseg.metrics.tracks import match_tracks, merged_scores, multi_label_scores


class Frame(NamedTuple):
    """One annotated frame; ``where`` names the prediction in messages, ``weight`` is what each pixel counts."""

    where: str
    number: int
    truth: Labels
    prediction: Labels
    weight: NDArray[np.float64] | None


def score_moving(frames: Iterable[Frame], rules: Rules, times: Times | None = None) -> SequenceScore:
    """Pu, Ru, Fu, multi-label and merged, J merged; with motion times J while moving, and false objects.

    Raises
    ------
    FormatError
        With ``official``, where the published program stops: no background pixel in truth or prediction.
    """
    sums, j, kept, where = PairSums(), [], [], ""
    for frame in frames:
        counts = _counts(frame, rules.void)
        sums.add(counts)
        j.append(merged_j(counts))
        where = frame.where
        if times is not None:
            kept.append((frame.number, counts))
    table = sums.table()
    if rules.official and not (0 in table.truth and 0 in table.prediction):
        side = "prediction" if 0 in table.truth else "truth"
        raise FormatError(
            f"{where}: the official program stops at this sequence (KeyError: no background pixel in the {side}); "
            "without --official the value of the formula is given"
        )
    several, merged = multi_label_scores(table), merged_scores(table)
    values = {"Fu": several.fu, "Pu": several.pu, "Ru": several.ru, "Fu_binary": merged.fu}
    values |= {"Pu_binary": merged.pu, "Ru_binary": merged.ru, "J": 100 * float(np.mean(j))}
    match = match_tracks(table)
    if times is not None:
        unknown = sorted(set(times) - set(table.truth.tolist()))
        if unknown:
            raise FormatError(
                f"motion times name the object {unknown[0]}, which the truth of {where} does not have"
            )
        moving = motion_scores(kept, match.partners(), times)
        values |= dict(zip(MOTION_METRICS, moving, strict=True))
    return SequenceScore(values, len(match.truth))


def score_fbms(frames: Iterable[Frame], rules: Rules) -> SequenceScore:
    """P, R, F of the FBMS evaluator."""
    sums = PairSums()
    for frame in frames:
        sums.add(_counts(frame, rules.void, weighted=True))
    table = sums.table()
    scores = region_scores(table)
    return SequenceScore({"F": scores.f, "P": scores.p, "R": scores.r}, int((table.truth != 0).sum()))


def score_one_object(frames: Iterable[Frame], rules: Rules) -> SequenceScore:
    """J and F of everything that is not background, as DAVIS 2016 scores."""
    series = []
    for frame in frames:
        truth, prediction = outside_void(frame.truth, frame.prediction, rules.void)
        masks = (truth != 0).view(np.uint8), (prediction != 0).view(np.uint8)
        series.append(frame_scores(*masks, [(1, 1)]))
    j, f = np.array(series)[..., 0].T
    return SequenceScore(_davis_values(j, f, rules.official), 1)


def score_objects(frames: Iterable[Frame], objects: int, rules: Rules) -> SequenceScore:
    """J and F of each object under its own id, as the semi-supervised protocol of DAVIS 2017 scores.

    Raises
    ------
    FormatError
        An id above the number of objects.
    """
    series, pairs = [], [(n, n) for n in range(1, objects + 1)]
    for frame in frames:
        _refuse_ids(frame, objects, f"the highest id of the truth is {objects}")
        truth = frame.truth if rules.void is None else np.where(frame.truth == rules.void, 0, frame.truth)
        series.append(frame_scores(truth, frame.prediction, pairs))
    j, f = np.array(series).transpose(1, 2, 0)
    return _objects_score(j, f, rules.official)


def score_proposals(frames: Iterable[Frame], objects: int, rules: Rules) -> SequenceScore:
    """J and F of each object's best proposal, as the unsupervised protocol of DAVIS 2017 scores.

    Raises
    ------
    FormatError
        More than 20 proposals.
    """

    def checked() -> Iterable[tuple[Labels, Labels]]:
        for frame in frames:
            _refuse_ids(frame, PROPOSALS, f"the protocol allows {PROPOSALS} proposals")
            yield frame.truth, frame.prediction

    matched = match_proposals(checked(), objects, rules.void)
    return _objects_score(matched.j, matched.f, rules.official)


def _objects_score(j: NDArray[np.float64], f: NDArray[np.float64], official: bool) -> SequenceScore:
    """From J and F (objects, frames)."""
    objects = {n: _davis_values(*rows, official) for n, rows in enumerate(zip(j, f, strict=True), 1)}
    values = {name: float(np.mean([o[name] for o in objects.values()])) for name in DAVIS_METRICS}
    return SequenceScore(values, len(objects), objects)


def _davis_values(j: NDArray[np.float64], f: NDArray[np.float64], official: bool) -> dict[str, float]:
    region, outline = statistics(j, official), statistics(f, official)
    return dict(zip(DAVIS_METRICS, ((region.mean + outline.mean) / 2, *region, *outline), strict=True))


def _counts(frame: Frame, void: int | None, weighted: bool = False) -> PairCounts:
    """Pair counts outside void."""
    weight = frame.weight if weighted else None
    if void is None:
        return pair_counts(frame.truth, frame.prediction, weight)
    keep = frame.truth != void
    return pair_counts(frame.truth[keep], frame.prediction[keep], None if weight is None else weight[keep])


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
