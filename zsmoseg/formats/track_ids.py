"""Which object an annotation is of: the field of COCO JSON that tells it, as tools write it, and the number it gets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zsmoseg.errors import FormatError
from zsmoseg.formats.annotations import Entry
from zsmoseg.formats.overlaps import HIGHEST
from zsmoseg.video.sources import natural

IDS = ("track_id", "instance_id")
"""Fields that tell objects through the video; of annotations, or of their ``attributes`` (CVAT)."""

Value = int | str
NUMBER = re.compile(r"-?(0|[1-9][0-9]{0,17})")
"""A text that is a whole number, as it would be written."""


def track_ids(annotations: Sequence[Entry], path: Path) -> list[Value] | None:
    """What tells the object of each annotation; None where nothing does.

    Raises
    ------
    FormatError
        If only some have it, or it is neither a whole number nor a name.
    """
    for inner in (False, True):
        for key in IDS:
            found = [_value(a, key, inner) for a in annotations]
            having = sum(value is not None for value in found)
            if having and having < len(found):
                raise FormatError(
                    f"{path}: {having} of {len(found)} annotations have a {key}; give it to all or to none"
                )
            if having:
                return _alike(
                    [
                        _checked(v, f"{path}, annotation {a['id']}: {key}")
                        for v, a in zip(found, annotations, strict=True)
                    ]
                )
    return None


def _value(annotation: Entry, key: str, inner: bool) -> Any:
    place = annotation.get("attributes") if inner else annotation
    return place.get(key) if isinstance(place, dict) else None


def _checked(value: Any, where: str) -> Value:
    """A whole number (as a float, too: tables write them so), or a name."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int | str) or value == "":
        raise FormatError(f"{where} is {str(value)[:20] or 'empty'}; give a whole number or a name")
    return value


def _alike(values: list[Value]) -> list[Value]:
    """Where some ids are numbers, texts of a number are that number: 7 and "7" are one object."""
    if not any(isinstance(value, int) for value in values):
        return values
    return [int(v) if isinstance(v, str) and NUMBER.fullmatch(v) else v for v in values]


def numbers_of(values: Sequence[Value], path: Path) -> tuple[dict[Value, int], str]:
    """The number of each object: its id where that can be stored, else 1.. in order; and what to say of it.

    Raises
    ------
    FormatError
        If there are more than can be numbered.
    """
    whole = sorted({v for v in values if isinstance(v, int)})
    given: list[Value] = [*whole, *sorted({v for v in values if isinstance(v, str)}, key=natural)]
    if len(given) == len(whole) and (not whole or (whole[0] >= 1 and whole[-1] <= HIGHEST)):
        return {n: n for n in whole}, ""
    if len(given) > HIGHEST:
        raise FormatError(f"{path}: has {len(given)} objects; at most {HIGHEST} can be numbered")
    return {value: k for k, value in enumerate(given, 1)}, ids_in_order(given)


def ids_in_order(given: Sequence[Value]) -> str:
    """What to say of ids that are numbered 1.. in order; nothing where they are so already."""
    if list(given) == list(range(1, len(given) + 1)):
        return ""
    last = f" to {given[-1]} is {len(given)}" if len(given) > 1 else ""
    return f"ids numbered in order: {given[0]} is 1{last}"
