"""What is published: the sequences of each benchmark, and the figures of other methods on them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any


@dataclass(frozen=True)
class PublishedRow:
    """What a method reaches on all of a published list, as printed, in percent.

    Attributes
    ----------
    protocol, benchmark
        How it was scored, and on which list of sequences.
    labels
        ``multi`` or ``binary``.
    method, training
        Whose it is, and what it has learned from.
    values
        The numbers that the protocol calls ``published``.
    source
        Where they are printed.
    """

    protocol: str
    benchmark: str
    labels: str
    method: str
    training: str
    values: tuple[float, ...]
    source: str


@cache
def sequence_lists() -> dict[str, tuple[str, ...]]:
    """The published sequence lists by name: ``davis-2016-val``, ``ytvos-moving-val``, ..."""
    return {name: tuple(names.split()) for name, names in _toml("lists.toml").items()}


@cache
def published_rows() -> tuple[PublishedRow, ...]:
    """The published figures that are known."""
    return tuple(_rows(_toml("published.toml")["table"]))


def _rows(tables: Sequence[Mapping[str, Any]]) -> Iterator[PublishedRow]:
    for table in tables:
        about = {name: value for name, value in table.items() if name != "rows"}
        for method, training, *values in table["rows"]:
            yield PublishedRow(**about, method=method, training=training, values=tuple(values))


def _toml(name: str) -> dict[str, Any]:
    return tomllib.loads((files("zsmoseg.datasets") / name).read_text(encoding="utf-8"))
