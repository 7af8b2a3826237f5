"""The protocols by name: all that tells one from another stands in its entry. A new one is a new entry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from zsmoseg.metrics.clips import Clip, SequenceScore
from zsmoseg.metrics.registries import Deferred, entry

INNER = "the annotated frames without the first and the last"
EVERY = "every annotated frame"


@dataclass(frozen=True)
class Protocol:
    """What a protocol scores, in words where a reader must know them.

    Attributes
    ----------
    about : a few words for the help.
    score : from a clip to the numbers called ``metrics`` (and ``motion_metrics`` if it has motion times).
    metrics : names of the numbers, the first of them the one that ranks methods.
    objects : what counts as an object.
    frames : which frames count.
    truth : label images, or labelled track points.
    annotations : the folder of DAVIS that holds its annotations.
    counted : whether the objects are those of the first annotated frame, ids 1 to the highest.
    weighted : whether pixels count by the probability of their region, where the dataset has it.
    void : the label that is void, and what becomes of its pixels.
    mean : what the mean over a dataset is taken over.
    finish : what is done to the means of all metrics, by name, each (..., ).
    unit : of most numbers.
    more : further metrics by name, functions of truth and prediction (H, W), void being background in both; the
        number of a sequence is the mean over its frames.
    motion_metrics : names of the numbers that are added where motion times are given.
    compared : the metrics of which differences are shown; all if empty.
    lists : by name of a dataset, the published list of sequences that the authors score.
    published : what the published figures on such a list are called, if there are any.
    one_object : whether the mean of the sequences with one object is shown too.
    """

    about: str
    score: Callable[[Clip], SequenceScore]
    metrics: tuple[str, ...]
    objects: str
    frames: str = EVERY
    truth: Literal["masks", "points"] = "masks"
    annotations: str = "Annotations"
    counted: bool = False
    weighted: bool = False
    void: int | None = None
    void_rule: str = "left out"
    mean: Literal["sequences", "objects"] = "sequences"
    finish: Callable[[dict[str, Any]], dict[str, Any]] = dict
    unit: Literal["percent", "0 to 1"] = "percent"
    more: Mapping[str, Callable[[Any, Any], float]] = field(default_factory=dict)
    motion_metrics: tuple[str, ...] = ()
    compared: tuple[str, ...] = ()
    lists: Mapping[str, str] = field(default_factory=dict)
    published: tuple[str, ...] = ()
    one_object: bool = False

    @property
    def inner(self) -> bool:
        """Whether the first and the last frame are dropped."""
        return self.frames == INNER

    def names(self, times: bool) -> tuple[str, ...]:
        """All metrics; ``times``: with motion times."""
        return (*self.metrics, *self.more, *(self.motion_metrics if times else ()))


DAVIS_METRICS = ("J&F", "J", "J_recall", "J_decay", "F", "F_recall", "F_decay")
DAVIS_COMPARED = ("J&F", "J", "F")
PROPOSALS = 20
"""Proposals that the unsupervised protocol of DAVIS 2017 allows."""

PROTOCOLS: dict[str, Protocol] = {
    "davis-2016": Protocol(
        "J and F of all labels as one object (Perazzi et al. 2016)",
        Deferred("zsmoseg.metrics.davis_protocols:score_one_object"),
        DAVIS_METRICS,
        "all labels as one object",
        INNER,
        unit="0 to 1",
        compared=DAVIS_COMPARED,
        lists={"DAVIS": "davis-2016-val"},
        published=("J", "F"),
    ),
    "davis-2017": Protocol(
        "J and F of each object by its id (Pont-Tuset et al. 2017)",
        Deferred("zsmoseg.metrics.davis_protocols:score_objects"),
        DAVIS_METRICS,
        "those of the first annotated frame, by id",
        INNER,
        counted=True,
        void=255,
        void_rule="background in the truth",
        mean="objects",
        unit="0 to 1",
        compared=DAVIS_COMPARED,
        lists={"DAVIS": "davis-2017-val"},
    ),
    "davis-2017-unsupervised": Protocol(
        "J and F of each object's best proposal (Caelles et al. 2019)",
        Deferred("zsmoseg.metrics.davis_protocols:score_proposals"),
        DAVIS_METRICS,
        "those of the first annotated frame, each with the proposal that the best assignment gives it; "
        f"at most {PROPOSALS} proposals, surplus free",
        annotations="Annotations_unsupervised",
        counted=True,
        void=255,
        mean="objects",
        unit="0 to 1",
        compared=DAVIS_COMPARED,
        lists={"DAVIS": "davis-2017-val"},
    ),
    "moving": Protocol(
        "Pu Ru Fu of tracks (Dave, Tokmakov, Ramanan 2019) and J",
        Deferred("zsmoseg.metrics.moving_protocol:score_moving"),
        ("Fu", "Pu", "Ru", "Fu_binary", "Pu_binary", "Ru_binary", "J"),
        "tracks over the whole sequence; _binary and J: all labels merged into one",
        motion_metrics=("J_moving", "false_objects"),
        compared=("J", "Fu", "Fu_binary", "J_moving", "false_objects"),
        lists={"DAVIS": "davis-moving-val", "YouTube-VOS": "ytvos-moving-val", "FBMS-59": "fbms-59-test"},
        published=("Pu", "Ru", "Fu"),
        one_object=True,
    ),
    "fbms": Protocol(
        "P R F of regions (Ochs, Malik, Brox 2014)",
        Deferred("zsmoseg.metrics.fbms:score_regions"),
        ("F", "P", "R"),
        "background is a region, surplus clusters are free; mean F from mean P and mean R",
        weighted=True,
        finish=Deferred("zsmoseg.metrics.fbms:f_of_means"),
        compared=("F", "P", "R"),
        lists={"FBMS-59": "fbms-59-test"},
    ),
    "points": Protocol(
        "misclassified tracks (Tron, Vidal 2007)",
        Deferred("zsmoseg.metrics.misclassification:score_tracks"),
        ("error",),
        "misclassified tracks, labels named at best; a track has the label that most of its frames give it",
        frames="every frame of the tracks",
        truth="points",
    ),
}
DEFAULTS = {"masks": "moving", "points": "points"}
"""The protocol that is used where none is named, by the kind of truth."""


@dataclass(frozen=True)
class Rules:
    """How to score: protocol, the label that is void (``None``: none), the official number where they differ.

    Raises
    ------
    SettingsError
        There is no such protocol.
    """

    protocol: str
    void: int | None
    official: bool = False

    def __post_init__(self) -> None:
        protocol_named(self.protocol)

    @property
    def entry(self) -> Protocol:
        """All that the protocol says."""
        return protocol_named(self.protocol)


def protocol_named(name: str) -> Protocol:
    """The entry of a protocol; ``SettingsError`` where there is none of this name."""
    return entry(PROTOCOLS, "protocol", name)


def protocols_with(truth: str) -> str:
    """The names of the protocols for one kind of truth, as an option."""
    return ", ".join(f"--protocol {name}" for name, entry in PROTOCOLS.items() if entry.truth == truth)
