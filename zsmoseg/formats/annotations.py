"""What the JSON of COCO and of YouTube-VIS have in common: fields that must be there, names of videos."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from zsmoseg.errors import FormatError
from zsmoseg.formats.npy import DAMAGED, damaged
from zsmoseg.video.bounds import TooLarge, check_size

Entry = dict[str, Any]
STROKES, EMPTY = "polygons of fewer than three points", "annotations without a mask"
NO_PIXEL = "masks that cover no pixel"
"""What is left out of JSON."""

HIGHEST_SCORE = 1e30
"""Of 32 bits nearly."""


def load_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises
    ------
    FormatError
        If it is no JSON.
    """
    try:
        return json.loads(path.read_bytes())
    except (*DAMAGED, RecursionError) as error:
        raise damaged(path, error) from error


def field(entry: Any, key: str, kind: type | tuple[type, ...], where: str) -> Any:
    """``entry[key]``, there and of a kind; else a ``FormatError`` that begins with ``where``."""
    if not isinstance(entry, dict) or key not in entry:
        raise FormatError(f"{where}: has no {key!r}; write the file as COCO or YouTube-VIS describe it")
    value = entry[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        raise FormatError(
            f"{where}: {key!r} is {type(value).__name__}; write it as COCO or YouTube-VIS describe it"
        )
    return value


def entries(content: Entry, key: str, path: Path) -> list[Entry]:
    """A list of the file, its ids all different."""
    found: list[Entry] = field(content, key, list, str(path))
    twice = [
        n for n, times in Counter(field(e, "id", int, f"{path}, {key}") for e in found).items() if times > 1
    ]
    if twice:
        raise FormatError(f"{path}: two {key} have the id {twice[0]}; give each its own")
    return found


def choose_video(names: Sequence[str], video: str | None, path: Path) -> str:
    """The one of ``names`` that is meant: the only one, or the one called like the video.

    Raises
    ------
    FormatError
        If there is none, or several could be meant.
    """
    if len(names) == 1:
        return names[0]
    fit = [name for name in names if video is not None and video in (name, name.replace("/", "-"))]
    if len(fit) != 1:
        shown = ", ".join(sorted(names)[:5]) + (", ..." if len(names) > 5 else "")
        called = "" if video is None else f", not one called {video}"
        raise FormatError(
            f"{path}: holds {len(names)} videos ({shown}){called}; name the video like one of them"
        )
    return fit[0]


def size_of(entry: Entry, where: str) -> tuple[int, int]:
    """(H, W) of an image or video."""
    height, width = (int(field(entry, key, int, where)) for key in ("height", "width"))
    try:
        check_size(height, width)
    except TooLarge as error:
        raise FormatError(f"{where}: {error}; write the size of the images") from error
    return height, width


def score_of(entry: Entry, where: str) -> float:
    """The score of an annotation, which says what lies on top."""
    score = field(entry, "score", (int, float), where)
    if not abs(score) <= HIGHEST_SCORE:  # NaN too
        raise FormatError(f"{where}: the score of annotation {entry['id']} is no number; give finite ones")
    return float(score)


def normalised_notes(segmentations: Iterable[Any]) -> list[str]:
    """What to say of polygons whose coordinates are all from 0 to 1: one note where there are some, else none."""
    count = sum(map(_is_normalised, segmentations))
    what = "masks have polygons of coordinates from 0 to 1 only"
    return [f"{count} {what}: if those are shares of width and height, multiply them"] if count else []


def _is_normalised(segmentation: Any) -> bool:
    numbers = (
        [n for polygon in segmentation for n in (polygon if isinstance(polygon, list) else [None])]
        if isinstance(segmentation, list)
        else []
    )
    return bool(numbers) and all(isinstance(n, int | float) and 0 <= n <= 1 for n in numbers)
