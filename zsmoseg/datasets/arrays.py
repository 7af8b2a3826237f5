"""Masks of a whole video in one array, .npz or .npy, read frame by frame: the format of the tracks' evaluator."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from zsmoseg.errors import FormatError

Labels = NDArray[np.integer[Any]]
Read = Callable[[int], tuple[str, Labels]]
"""Of the index of a frame: what to call it in messages, and its labels (H, W)."""

ARRAYS = (".npz", ".npy")
STEP = 5
"""YouTube-VOS annotates every 5th frame; arrays made for the tracks' evaluator hold these only."""


class FrameStream:
    """One (frames, H, W) array on disk; of an .npz its only array.

    Raises
    ------
    FormatError
        Not readable, several arrays, not of this shape, or stored column by column.
    """

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self.path = path
        try:
            self._stream = stack.enter_context(_member(path, stack))
            version = npy.read_magic(self._stream)
            header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            self.shape, column_major, self._dtype = header(self._stream)
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise FormatError(f"{path}: cannot be read as an array ({error})") from error
        if len(self.shape) != 3 or column_major or self._dtype.kind not in "biuf":
            raise FormatError(
                f"{path}: expected numbers (frames, height, width) stored row by row, found {self._dtype} {self.shape}"
            )
        self._position = 0

    def reader(self, rows: Sequence[int]) -> Read:
        """Reads the frame ``rows[index]``; indices must ascend."""
        return lambda index: (f"{self.path}, frame {rows[index]}", self._row(rows[index]))

    def _row(self, row: int) -> Labels:
        size = self._dtype.itemsize * self.shape[1] * self.shape[2]
        try:
            for _ in range(row - self._position):
                self._stream.read(size)
            values = np.frombuffer(self._stream.read(size), self._dtype).reshape(self.shape[1:])
        except (OSError, ValueError, EOFError, zlib.error, zipfile.BadZipFile) as error:
            raise FormatError(f"{self.path}: frame {row} cannot be read ({error})") from error
        self._position = row + 1
        return _whole(values, f"{self.path}, frame {row}")


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


def _member(path: Path, stack: ExitStack) -> IO[bytes]:
    """The .npy stream of a file."""
    if path.suffix == ".npy":
        return path.open("rb")
    archive = stack.enter_context(zipfile.ZipFile(path))
    names = archive.namelist()
    if len(names) != 1:
        raise FormatError(f"{path}: holds {len(names)} arrays ({', '.join(names[:4])}), expected one")
    return archive.open(names[0])


def _whole(values: NDArray[Any], where: str) -> Labels:
    """Labels as integers; the reference tracker writes floats."""
    if values.dtype.kind == "f":
        if not np.array_equal(values, np.rint(values)):
            raise FormatError(f"{where}: holds values that are no whole numbers; labels are expected")
        return values.astype(np.int64)
    return values.astype(np.uint8) if values.dtype.kind == "b" else values
