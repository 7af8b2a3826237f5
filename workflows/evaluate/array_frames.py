"""Masks of a whole video in one array, .npz or .npy, as the tracks' evaluator has them: which frame is which."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats.npy import Rows, only_key

Labels = NDArray[np.integer[Any]]
Read = Callable[[int], tuple[str, Labels]]
"""Of the index of a frame: what to call it in messages, and its labels (H, W)."""

ARRAYS = (".npz", ".npy")
STEP = 5
"""YouTube-VOS annotates every 5th frame; arrays made for the tracks' evaluator hold these only."""


def open_volume(path: Path) -> Rows:
    """One (frames, H, W) array of numbers; of an .npz its only array.

    Raises
    ------
    FormatError
        Not readable, several arrays, or not of this shape.
    """
    rows = Rows(path, only_key(path))
    if len(rows.shape) != 3 or rows.dtype.kind not in "biuf":
        raise FormatError(
            f"{path}: expected numbers (frames, height, width), found {rows.dtype} {rows.shape}"
        )
    return rows


def reader(volume: Rows, chosen: Sequence[int]) -> Read:
    """Reads the frame ``chosen[index]`` of an array."""

    def read(index: int) -> tuple[str, Labels]:
        where = f"{volume.path}, frame {chosen[index]}"
        return where, _whole(volume.read(chosen[index]), where)

    return read


def array_rows(path: Path, numbers: Sequence[int], count: int) -> list[int]:
    """Which frame of an array belongs to each annotated one.

    Parameters
    ----------
    numbers : of the annotated frames, ascending.
    count : frames of the array: the annotated ones, all (the number is the index), or every 5th.

    Raises
    ------
    FormatError
        None of these.
    """
    if count == len(numbers):
        return list(range(count))
    if count > numbers[-1]:
        return list(numbers)
    if count > numbers[-1] // STEP and not any(number % STEP for number in numbers):
        return [number // STEP for number in numbers]
    raise FormatError(
        f"{path}: holds {count} frames; {len(numbers)} are annotated, the last of them is number {numbers[-1]}"
    )


def _whole(values: NDArray[Any], where: str) -> Labels:
    """Labels as integers; the reference tracker writes floats."""
    if values.dtype.kind == "f":
        if not np.array_equal(values, np.rint(values)):
            raise FormatError(f"{where}: holds values that are no whole numbers; labels are expected")
        return values.astype(np.int64)
    return values.astype(np.uint8) if values.dtype.kind == "b" else values
