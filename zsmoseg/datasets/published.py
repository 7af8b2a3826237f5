"""What is published: the sequences of each benchmark, and the figures of other methods on them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any


@dataclass(frozen=True)
class PublishedRow:
    """Pu, Ru, Fu of a method as its paper prints them, in percent; ``labels`` is ``multi`` or ``binary``."""

    benchmark: str
    labels: str
    method: str
    values: tuple[float, float, float]
    source: str


@cache
def sequence_lists() -> dict[str, tuple[str, ...]]:
    """The published sequence lists by name: ``davis-2016-val``, ``ytvos-moving-val``, ..."""
    return {name: tuple(names.split()) for name, names in _toml("lists.toml").items()}


@cache
def published_rows() -> tuple[PublishedRow, ...]:
    """The published figures that are known."""
    rows = _toml("published.toml")["row"]
    return tuple(PublishedRow(**row | {"values": tuple(row["values"])}) for row in rows)


def _toml(name: str) -> dict[str, Any]:
    return tomllib.loads((files("zsmoseg.datasets") / name).read_text(encoding="utf-8"))
