"""The truth of one sequence: which frames are annotated, and their labels, read one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.formats.label_images import read_labels
from zsmoseg.formats.names import frame_number

Labels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Truth:
    """Annotated frames of a sequence.

    Attributes
    ----------
    name : of the sequence.
    frames : names of the annotated frames, in order, as masks of them are called (without suffix).
    numbers : their frame numbers.
    files : of each frame, its annotation; several files are one binary mask for each object.
    note : what a reader of a table should know, or nothing.
    """

    name: str
    frames: tuple[str, ...]
    numbers: tuple[int, ...]
    files: tuple[tuple[Path, ...], ...]
    note: str = ""

    def labels(self, index: int) -> Labels:
        """The annotation of the ``index``-th annotated frame, (H, W); 0 = background.

        Raises
        ------
        DatasetError
            A file cannot be used.
        """
        try:
            layers = [read_labels(path) for path in self.files[index]]
        except FormatError as error:
            raise DatasetError(str(error)) from error
        if len(layers) == 1:
            return layers[0]
        out = np.zeros(layers[0].shape, np.uint8)
        for number, layer in enumerate(layers, 1):
            if layer.shape != out.shape:
                raise DatasetError(f"{self.files[index][number - 1]}: has another size than object 1")
            out[layer > 0] = number
        return out

    def weights(self, index: int) -> NDArray[np.float64] | None:
        """What each pixel counts, (H, W); ``None`` for 1."""
        return None

    def scored(self, inner: bool) -> Truth:
        """The part of the frames that is scored: all, or with ``inner`` without the first and the last.

        Raises
        ------
        DatasetError
            None is left.
        """
        if not inner:
            return self
        if len(self.frames) < 3:
            raise DatasetError(
                f"{self.name}: has {len(self.frames)} annotated frames; this protocol drops the first and the last, "
                "so none is left"
            )
        return replace(self, frames=self.frames[1:-1], numbers=self.numbers[1:-1], files=self.files[1:-1])

    def file(self, index: int) -> Path:
        """The file to name in messages about a frame."""
        return self.files[index][0]


@dataclass(frozen=True)
class Points:
    """Track points of a sequence with their groups, instead of masks.

    Attributes
    ----------
    name : of the sequence.
    path : the file of the tracks.
    """

    name: str
    path: Path


def numbered(names: Sequence[str], folder: Path) -> tuple[int, ...]:
    """Frame numbers of the files called ``names``, which must ascend.

    Raises
    ------
    DatasetError
        A name without a number, or two with the same.
    """
    numbers: list[int] = []
    for name in names:
        number = frame_number(name)
        if number is None:
            raise DatasetError(f"{folder / name}: has no frame number in its name")
        if number in numbers[-1:]:
            raise DatasetError(f"{folder / name}: has the same frame number as the file before it")
        numbers.append(number)
    return tuple(numbers)
