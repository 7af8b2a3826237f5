"""J and F of DAVIS (Perazzi et al. 2016, Pont-Tuset et al. 2017): of a frame, a sequence, and matched proposals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.metrics.contours import Contour, contour, contour_f, grow, tolerance
from zsmoseg.metrics.counts import Labels, pair_counts
from zsmoseg.metrics.protocols import PROPOSALS
from zsmoseg.metrics.regions import object_j

Floats = NDArray[np.float64]


class Statistics(NamedTuple):
    """Mean, share above 0.5, and loss from the first quarter of the frames to the last."""

    mean: float
    recall: float
    decay: float


class Matched(NamedTuple):
    """J and F (objects, frames) of the proposals matched to each object, and their ids (objects,)."""

    j: Floats
    f: Floats
    proposal: NDArray[np.int64]


def statistics(values: Floats, official: bool = False) -> Statistics:
    """The three numbers of a series of per-frame values, (frames,).

    Parameters
    ----------
    official : keep the edges of the quarters in 8 bits as the evaluators do: beyond 256 frames they wrap, and
        the decay is wrong or nan.
    """
    edges = np.round(np.linspace(1, len(values), 5) + 1e-10).astype(int) - 1
    if official:
        edges %= 256
    first, last = values[edges[0] : edges[1] + 1], values[edges[3] : edges[4] + 1]
    decay = float(first.mean() - last.mean()) if len(first) and len(last) else float("nan")
    return Statistics(float(values.mean()), float(np.mean(values > 0.5)), decay)


def frame_scores(
    truth: Labels, prediction: Labels, pairs: Sequence[tuple[int, int]]
) -> tuple[list[float], list[float]]:
    """J and F of pairs of labels in one frame, each mask's outline drawn once.

    Parameters
    ----------
    truth, prediction : (H, W) integers >= 0.
    pairs : (true label, predicted label), both above 0; a label that is not there is an empty mask.
    """
    counts = pair_counts(truth, prediction)
    radius = tolerance(truth.shape)
    mine = _contours(truth, radius, {a for a, _ in pairs} & set(counts.truth.tolist()))
    other = _contours(prediction, radius, {b for _, b in pairs} & set(counts.prediction.tolist()))
    j = [object_j(counts, *pair) for pair in pairs]
    return j, [contour_f(mine.get(a), other.get(b)) for a, b in pairs]


def outside_void(truth: Labels, prediction: Labels, void: int | None) -> tuple[Labels, Labels]:
    """Both with background where the truth is ``void``."""
    if void is None:
        return truth, prediction
    keep = truth != void
    return truth * keep, prediction * keep


def match_proposals(
    frames: Iterable[tuple[Labels, Labels]], objects: int, void: int | None = None
) -> Matched:
    """The unsupervised protocol of DAVIS 2017: each object with the proposal that a best assignment gives it.

    Parameters
    ----------
    frames : (truth, prediction), each (H, W); objects are 1.., proposals 1..20.
    objects : how many objects count; fewer proposals are filled up with empty ones, surplus ones are free.
    void : label of the pixels that are left out.

    Notes
    -----
    One assignment a sequence (the Hungarian method, Kuhn 1955), by the mean over frames of J plus that of F. Results come by object; the
    evaluator lists them by proposal, under the same names, with the same means.
    """
    pairs = [(o, p) for o in range(1, objects + 1) for p in range(1, max(PROPOSALS, objects) + 1)]
    scores, highest = [], objects
    for truth, prediction in frames:
        highest = max(highest, int(prediction.max(initial=0)))
        scores.append(frame_scores(*outside_void(truth, prediction, void), pairs))
    j, f = np.array(scores).transpose(1, 2, 0).reshape(2, objects, -1, len(scores))[:, :, :highest]
    rows, columns = scipy.optimize.linear_sum_assignment(-(j.mean(2) + f.mean(2)))
    return Matched(j[rows, columns], f[rows, columns], columns + 1)


def _contours(labels: Labels, radius: float, wanted: set[int]) -> dict[int, Contour]:
    """The outlines of labels that occur."""
    outlines = {}
    for label in sorted(wanted):
        mask = labels == label
        left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
        box = grow((slice(top, top + height), slice(left, left + width)), radius, labels.shape)
        outlines[label] = contour(mask[box], radius, box)
    return outlines
