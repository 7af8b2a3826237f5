"""The protocols by name: which frames, which void rule, which numbers, and how means are taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.metrics.davis import PROPOSALS

DAVIS_METRICS = ("J&F", "J", "J_recall", "J_decay", "F", "F_recall", "F_decay")
INNER = "the annotated frames without the first and the last"
EVERY = "every annotated frame"


@dataclass(frozen=True)
class Protocol:
    """What a protocol scores, in words where a reader must know them.

    Attributes
    ----------
    metrics : names of the numbers, the first of them the one that ranks methods.
    objects : what counts as an object.
    frames : which frames count.
    void : the label that is void, and what becomes of its pixels.
    mean : what the mean over a dataset is taken over.
    unit : of most numbers.
    """

    metrics: tuple[str, ...]
    objects: str
    frames: str = EVERY
    void: int | None = None
    void_rule: str = "left out"
    mean: Literal["sequences", "objects"] = "sequences"
    unit: Literal["percent", "0 to 1"] = "percent"

    @property
    def inner(self) -> bool:
        """Whether the first and the last frame are dropped."""
        return self.frames == INNER


PROTOCOLS = {
    "davis-2016": Protocol(DAVIS_METRICS, "all labels as one object", INNER, unit="0 to 1"),
    "davis-2017": Protocol(
        DAVIS_METRICS,
        "those of the first annotated frame, by id",
        INNER,
        void=255,
        void_rule="background in the truth",
        mean="objects",
        unit="0 to 1",
    ),
    "davis-2017-unsupervised": Protocol(
        DAVIS_METRICS,
        "those of the first annotated frame, each with the proposal that the best assignment gives it; "
        f"at most {PROPOSALS} proposals, surplus free",
        void=255,
        mean="objects",
        unit="0 to 1",
    ),
    "moving": Protocol(
        ("Fu", "Pu", "Ru", "Fu_binary", "Pu_binary", "Ru_binary", "J"),
        "tracks over the whole sequence; _binary and J: all labels merged into one",
    ),
    "fbms": Protocol(
        ("F", "P", "R"), "background is a region, surplus clusters are free; mean F from mean P and mean R"
    ),
    "points": Protocol(
        ("error",),
        "misclassified tracks, labels named at best; a track has the label that most of its frames give it",
        frames="every frame of the tracks",
    ),
}
MOTION_METRICS = ("J_moving", "false_objects")
"""Added to ``moving`` where motion times are given."""


@dataclass(frozen=True)
class Rules:
    """How to score: protocol, the label that is void (``None``: none), the official number where they differ."""

    protocol: str
    void: int | None
    official: bool = False


@dataclass
class SequenceScore:
    """Scores of one sequence: means, each object's where the protocol has them, how many objects there are."""

    values: dict[str, float]
    count: int
    objects: dict[int, dict[str, float]] = field(default_factory=dict)


def mean_scores(
    values: Mapping[str, NDArray[np.float64]], weight: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Means over sequences, along the last axis; nan (a number that a sequence does not have) is skipped.

    Parameters
    ----------
    values : of each metric (..., sequences).
    weight : (..., sequences) objects of each sequence, or ones.

    Notes
    -----
    F of the FBMS evaluator is that of the mean P and the mean R.
    """
    means = {}
    for name, column in values.items():
        counted = np.where(np.isnan(column), 0.0, weight)
        total = counted.sum(-1)
        mean = (np.nan_to_num(column) * counted).sum(-1) / np.where(total > 0, total, 1)
        means[name] = np.where(total > 0, mean, np.nan)
    if set(means) == {"F", "P", "R"}:
        both = means["P"] + means["R"]
        means["F"] = 2 * means["P"] * means["R"] / np.where(both > 0, both, 1)
    return means
