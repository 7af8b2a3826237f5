"""From frames to a sequence, from sequences to a dataset: the part of scoring that all protocols share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.metrics.clips import Clip, Frame, SequenceScore
from zsmoseg.metrics.davis import outside_void
from zsmoseg.metrics.protocols import Protocol


def score_clip(clip: Clip, protocol: Protocol) -> SequenceScore:
    """The numbers of one sequence: those of the protocol, and the frame means of its further metrics."""
    values: dict[str, list[float]] = {name: [] for name in protocol.more}

    def watched() -> Iterator[Frame]:
        for frame in clip.frames:
            labels = outside_void(frame.truth, frame.prediction, clip.void) if protocol.more else ()
            for name, metric in protocol.more.items():
                values[name].append(metric(*labels))
            yield frame

    found = protocol.score(replace(clip, frames=watched()))
    found.values |= {name: float(np.mean(column)) for name, column in values.items()}
    return found


def mean_scores(
    values: Mapping[str, NDArray[np.float64]], weight: NDArray[np.float64], protocol: Protocol
) -> dict[str, NDArray[np.float64]]:
    """Means over sequences, along the last axis; nan (a number that a sequence does not have) is skipped.

    Parameters
    ----------
    values : of each metric (..., sequences).
    weight : (..., sequences) objects of each sequence, or ones.
    protocol : its rule ``finish`` has the last word.
    """
    means: dict[str, Any] = {}
    for name, column in values.items():
        counted = np.where(np.isnan(column), 0.0, weight)
        total = counted.sum(-1)
        mean = (np.nan_to_num(column) * counted).sum(-1) / np.where(total > 0, total, 1)
        means[name] = np.where(total > 0, mean, np.nan)
    return protocol.finish(means)
