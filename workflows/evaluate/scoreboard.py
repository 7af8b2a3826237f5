"""Scores of several methods side by side: means, differences with their uncertainty, published figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zsmoseg.datasets.published import PublishedRow, published_rows, sequence_lists
from zsmoseg.metrics.clips import SequenceScore
from zsmoseg.metrics.means import mean_scores
from zsmoseg.metrics.protocols import Protocol, Rules

CONFIDENCE = 0.95
FEWEST = 6
"""Sequences from which a difference can be called clear: of five, all agree by chance once in 16 times."""


class Difference(NamedTuple):
    """``method`` less ``base``: difference of the means over ``sequences``, its interval (nan for one sequence)."""

    method: str
    base: str
    metric: str
    difference: float
    low: float
    high: float
    sequences: int

    @property
    def clear(self) -> bool:
        """Whether the interval leaves 0 out, and there are enough sequences to say so."""
        return self.sequences >= FEWEST and (self.low > 0 or self.high < 0)


@dataclass(frozen=True)
class Scoreboard:
    """Scores of every method and sequence under one protocol.

    Attributes
    ----------
    truth, sequences : the dataset, and which sequences, in words.
    benchmark : the published list that some of the sequences are in, or nothing.
    metrics : names of the numbers.
    methods : scores by method and sequence.
    notes : what a reader should know.
    """

    rules: Rules
    truth: str
    sequences: str
    benchmark: str
    metrics: tuple[str, ...]
    methods: dict[str, dict[str, SequenceScore]]
    notes: tuple[str, ...] = field(default=())

    def mean(self, method: str, one_object: bool = False) -> dict[str, float]:
        """Means of a method, by the protocol over sequences or objects; of sequences with one object only."""
        scores = [s for s in self.methods[method].values() if not one_object or s.count == 1]
        values, weight = _columns(scores, self.metrics, self.rules.entry)
        means = mean_scores(values, weight, self.rules.entry)
        return {name: float(value) for name, value in means.items()}

    def single(self) -> int:
        """How many sequences have one object in the truth."""
        return sum(score.count == 1 for score in next(iter(self.methods.values())).values())

    def published(self) -> list[PublishedRow]:
        """What others reach by the same protocol on all of the same list."""
        return [
            row
            for row in published_rows()
            if (row.protocol, row.benchmark) == (self.rules.protocol, self.benchmark)
        ]

    def published_on(self) -> str:
        """On which sequences that is, and on which of them this board is."""
        listed = set(sequence_lists()[self.benchmark])
        names = next(iter(self.methods.values())).keys()
        scored = len(listed & names)
        more = f", {len(names)} in all" if len(names) > scored else ""
        here = "" if names == listed else f"; scored here: {scored} of them{more}"
        return f"{self.benchmark}, all {len(listed)} sequences{here}"


def differences(board: Scoreboard) -> list[Difference]:
    """Each method less each one before it.

    Notes
    -----
    The interval is the percentile bootstrap of the difference of means over sequences, the same sequences
    drawn for both (paired), with a fixed seed.
    """
    found, protocol = [], board.rules.entry
    compared = [m for m in protocol.compared or board.metrics if m in board.metrics]
    for base, method in combinations(board.methods, 2):
        a, b = (_columns(list(board.methods[n].values()), board.metrics, protocol) for n in (base, method))
        found += [_difference(protocol, a, b, metric, method, base) for metric in compared]
    return found


def as_json(board: Scoreboard) -> dict[str, Any]:
    """All of it for machines; what is not a number is null."""
    about = describe(board)
    return {
        "protocol": board.rules.protocol,
        "about": about,
        "methods": {name: _method_json(board, name) for name in board.methods},
        "differences": [
            _finite(d._asdict() | {"confidence": CONFIDENCE, "clear": d.clear}) for d in differences(board)
        ],
        "published": [_published_json(board, row) for row in board.published()],
    }


def describe(board: Scoreboard) -> dict[str, str]:
    """Which protocol, frames and void rule made the numbers."""
    protocol = board.rules.entry
    void = board.rules.void
    words = {
        "truth": board.truth,
        "sequences": board.sequences,
        "frames": protocol.frames,
        "void": "none, 255 is a label like any other"
        if void is None
        else f"label {void} is {protocol.void_rule}",
        "objects": protocol.objects,
        "mean": f"over {protocol.mean}",
        "unit": protocol.unit,
    }
    if board.rules.official:
        words["numbers"] = "the official program's, its faults included"
    if board.notes:
        words["notes"] = "; ".join(board.notes)
    return words


def in_unit(board: Scoreboard, percent: float) -> float:
    """A published number, in percent, as the board has its own."""
    return percent if board.rules.entry.unit == "percent" else percent / 100


def _published_json(board: Scoreboard, row: PublishedRow) -> dict[str, Any]:
    values = [round(in_unit(board, value), 6) for value in row.values]
    about = {name: getattr(row, name) for name in ("method", "training", "labels", "source")}
    return {
        **about,
        "sequences": board.published_on(),
        **dict(zip(board.rules.entry.published, values, strict=True)),
    }


def _method_json(board: Scoreboard, name: str) -> dict[str, Any]:
    scores = board.methods[name]
    out: dict[str, Any] = {
        "sequences": {s: _finite({m: score.values[m] for m in board.metrics}) for s, score in scores.items()},
        "mean": _finite(board.mean(name)),
    }
    objects = {f"{s}_{n}": _finite(o) for s, score in scores.items() for n, o in score.objects.items()}
    if objects:
        out["objects"] = objects
    if board.rules.entry.one_object and board.single():
        out["mean_one_object"] = _finite(board.mean(name, one_object=True))
        out["sequences_with_one_object"] = board.single()
    return out


def _difference(
    protocol: Protocol, a: Columns, b: Columns, metric: str, method: str, base: str
) -> Difference:
    def statistic(chosen: NDArray[np.intp], axis: int = -1) -> NDArray[np.float64]:
        del axis  # always the last, as mean_scores has it
        one, other = ({n: v[chosen] for n, v in values.items()} for values, _ in (a, b))
        new, old = mean_scores(other, b[1][chosen], protocol), mean_scores(one, a[1][chosen], protocol)
        return new[metric] - old[metric]

    everything = np.arange(len(a[1]))
    value = float(statistic(everything))
    if len(everything) < 2 or math.isnan(value):
        return Difference(method, base, metric, value, math.nan, math.nan, len(everything))
    from scipy.stats import bootstrap  # a second to import, which scoring processes save

    interval = bootstrap(
        (everything,), statistic, vectorized=True, method="percentile", confidence_level=CONFIDENCE, rng=0
    ).confidence_interval
    return Difference(method, base, metric, value, float(interval.low), float(interval.high), len(everything))


Columns = tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]
"""Values of each metric (sequences,), and the weight of each sequence."""


def _columns(scores: Sequence[SequenceScore], metrics: Sequence[str], protocol: Protocol) -> Columns:
    by_object = protocol.mean == "objects"
    values = {name: np.array([score.values[name] for score in scores]) for name in metrics}
    return values, np.array([score.count if by_object else 1 for score in scores], np.float64)


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}
