"""How an artifact says what its arrays are: the fields of a frozen dataclass, with named dimensions.

    @dataclass(frozen=True)
    class Flow(Arrays):
        forward: Floats = video("pair", "component", "y", "x", dtype="int16", meaning="flow to the next frame")
        valid: Bools = table("pair", dtype="bool", meaning="whether the two frames are a pair")

A *video array* has a size that is known before anything is computed; every part writes its own shards of it. A
*table* is what a part, or a run of its frames, found out; of any size. Both are labelled alike: ``frame`` and
``pair`` are counted through the video, a dimension that is called like a table of ids has those as labels, others
are named here, or are plain rows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

TIMES = ("frame", "pair")
"""Dimensions that are counted through the video; a pair has the number of its first frame."""
IDS_OF = {"model": "object", "other": "object"}
"""Dimensions that have the labels of another: the objects once more, as models or as partners."""
LABELS: Mapping[str, Sequence[str]] = {"component": ("x", "y"), "channel": ("blue", "green", "red")}
"""Labels of the dimensions that mean the same in every artifact."""

RESERVED = frozenset(
    {
        "records",
        "time",
        "name",
        "start",
        "stop",
        "labels",
        "read",
        "of",
        "blocks",
        "has",
        "x",
        "y",
        *TIMES,
        *IDS_OF,
    }
)
"""Names that coordinates, folders or methods have."""

Codec = Literal["image", "flow", "label"]
Grid = Literal["working", "displayed"]


@dataclass(frozen=True)
class Field:
    """One array as it is declared.

    Attributes
    ----------
    dims, dtype, unit, meaning
        ``dtype`` by its numpy name, as stored.
    grid
        Whose pixels ``y`` and ``x`` are, of a video array; None: a table.
    fill
        What stands where nothing is known.
    scale
        Of a video array: what is stored is the value divided by it, rounded.
    codec
        Of a video array: ``image`` and ``flow`` (smooth numbers), ``label`` (runs of equal ones).
    add
        Of a table: where two runs of frames know the same object the values add up; otherwise the first stays.
    """

    dims: tuple[str, ...]
    dtype: str
    meaning: str
    unit: str = ""
    grid: Grid | None = None
    fill: float = 0
    scale: float = 1.0
    codec: Codec = "image"
    add: bool = False

    @property
    def attributes(self) -> dict[str, str]:
        """CF attributes."""
        about = {"long_name": self.meaning, "units": self.unit}
        return {name: text for name, text in about.items() if text}


def video(
    *dims: str,
    dtype: str,
    meaning: str,
    unit: str = "",
    grid: Grid = "working",
    fill: float = 0,
    scale: float = 1.0,
    codec: Codec = "image",
) -> Any:
    """A video array; see ``Field``."""
    field = Field(dims, dtype, meaning, unit, grid, fill, scale, codec)
    return _declared(field)


def table(
    *dims: str, dtype: str, meaning: str, unit: str = "", fill: float | None = None, add: bool = False
) -> Any:
    """A table; see ``Field``. Without ``fill`` floating numbers are NaN where unknown, others 0."""
    unknown = np.nan if np.dtype(dtype).kind == "f" and not add else 0
    return _declared(Field(dims, dtype, meaning, unit, fill=unknown if fill is None else fill, add=add))


def _declared(field: Field) -> Any:
    """None where it is left out; made by a factory, so that the class has no attribute of that name: see ``Arrays``."""
    about = {"array": field}
    return dataclasses.field(default_factory=lambda: None, repr=False, compare=False, metadata=about)


def fields_of(kind: type) -> Mapping[str, Field]:
    """The arrays that a dataclass declares, by name.

    Raises
    ------
    TypeError
        If one has a name that means something else already.
    """
    if kind not in _known:
        found = {f.name: f.metadata["array"] for f in dataclasses.fields(kind) if "array" in f.metadata}
        if taken := RESERVED & found.keys():
            raise TypeError(f"{kind.__name__}: {', '.join(sorted(taken))} is no name for an array")
        _known[kind] = found
    return _known[kind]


_known: dict[type, Mapping[str, Field]] = {}


def videos_of(kind: type) -> dict[str, Field]:
    """Those that are video arrays."""
    return {name: field for name, field in fields_of(kind).items() if field.grid is not None}


def tables_of(kind: type) -> dict[str, Field]:
    """Those that are tables."""
    return {name: field for name, field in fields_of(kind).items() if field.grid is None}
