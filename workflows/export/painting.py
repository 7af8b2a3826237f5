"""The ids of a finished video, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.painting.numbers import paint_table
from zsmoseg.workflows.object_numbers import objects_of_pieces
from zsmoseg.workflows.result import BLOCK, Result


def number_tables(result: Result, what: str, when: Literal["ever", "now"]) -> NDArray[np.uint16]:
    """(frames, objects) the id that every object is painted with at every frame; 0 = none.

    Parameters
    ----------
    what : ``group``: those that move; ``instance``: objects that move, ``object``: all, by the same numbers.
    when : a mover wherever it is seen, or only while it moves.
    """
    moving = result.moving()
    if what == "object":
        return np.tile(objects_of_pieces(result.groups).astype(np.uint16), (len(moving), 1))
    number = result.groups.instance if what == "instance" else result.groups.group
    return np.stack([paint_table(number, state, when) for state in moving])


def painted(result: Result, what: str, when: Literal["ever", "now"]) -> Iterator[NDArray[np.uint16]]:
    """(H, W) ids of every frame, at the displayed size; read in blocks. See ``number_tables``."""
    labels, tables = result.labels, number_tables(result, what, when)
    for start in range(0, len(tables), BLOCK):
        stop = min(start + BLOCK, len(tables))
        for table, label in zip(tables[start:stop], labels.of(start, stop).label, strict=True):
            yield table[label]


def names_of_ids(result: Result, what: str) -> dict[int, str]:
    """What networks call each id: the name of its largest object; ids without a name are left out."""
    found = result.groups
    number = {"group": found.group, "instance": found.instance}.get(what, objects_of_pieces(found))
    names: dict[int, str] = {}
    for n in np.argsort(found.area, kind="stable"):
        if result.categories and result.categories[n] and number[n]:
            names[int(number[n])] = result.categories[n]
    return names


def image_names(result: Result, folder: bool = False) -> list[str]:
    """File names of the source's images, with their folder if wanted; of a video file's frames as PNG."""
    probe = result.probe
    names = [Path(file).name for file in probe.files] or [f"{name}.png" for name in probe.names]
    own = Path(probe.files[0]).parent.name if probe.files else result.name
    return [f"{own}/{name}" for name in names] if folder else names
