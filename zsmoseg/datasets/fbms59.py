"""FBMS-59 (Ochs, Malik, Brox 2014): colour-coded regions on some frames, listed in a definition file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zsmoseg.datasets.sequence import Labels, Truth
from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.formats.label_images import read_values


@dataclass(frozen=True)
class FbmsTruth(Truth):
    """Annotated frames of an FBMS sequence; ``colours`` in order of the regions, region 0 the background."""

    colours: tuple[int, ...] = ()

    def labels(self, index: int) -> Labels:
        """Regions; a colour that the definition file does not list is background."""
        values = _values(self.file(index)).astype(np.int64)
        if values.ndim == 3:
            values = (values[..., 0] << 16) + (values[..., 1] << 8) + values[..., 2]
        order = np.argsort(self.colours)
        known = np.array(self.colours)[order]
        place = np.minimum(np.searchsorted(known, values), len(known) - 1)
        return np.where(known[place] == values, order[place], 0)

    def weights(self, index: int) -> NDArray[np.float64] | None:
        """The probability of each pixel's region, where the image for it is there."""
        path = self.file(index).with_suffix(".pgm")
        return _values(path) / 255.0 if path != self.file(index) and path.is_file() else None


def is_fbms(folder: Path) -> bool:
    """Whether ``folder`` is one sequence of FBMS-59."""
    return any((folder / "GroundTruth").glob("*.dat"))


def fbms_sequence(folder: Path) -> FbmsTruth:
    """Read the definition file of a sequence.

    Raises
    ------
    DatasetError
        No file, several, not of the expected form, or files that are not there.
    """
    ground = folder / "GroundTruth"
    definitions = sorted(ground.glob("*.dat"))
    if len(definitions) != 1:
        raise DatasetError(f"{ground}: holds {len(definitions)} definition files (.dat), expected one")
    path = definitions[0]
    lines = [line.strip() for line in path.read_text(encoding="latin-1").splitlines()]
    lines = [line for line in lines if line]
    colours = _integers(lines, r"Scale of region \d+:", path)
    labelled = _integers(lines, "Total number of labeled frames for this shot:", path)[0]
    numbers = _integers(lines, "Frame number:", path)
    files = [ground / Path(name).name for name in _after(lines, "File name:", path)]
    frames = [Path(name).stem for name in _after(lines, "Input file name:", path)]
    if not labelled == len(numbers) == len(files) == len(frames):
        raise DatasetError(f"{path}: announces {labelled} labelled frames, lists {len(files)}")
    missing = next((file for file in files if not file.is_file()), None)
    if missing is not None:
        raise DatasetError(f"{missing}: is missing; {path.name} lists it")
    return FbmsTruth(
        folder.name, tuple(frames), tuple(numbers), tuple((f,) for f in files), colours=tuple(colours)
    )


def _integers(lines: Sequence[str], key: str, path: Path) -> list[int]:
    """The whole numbers that follow lines of the form ``key``."""
    found = _after(lines, key, path)
    wrong = next((text for text in found if not text.isdecimal()), None)
    if wrong is not None:
        raise DatasetError(f"{path}: {wrong!r} after {key!r} is no whole number")
    return [int(text) for text in found]


def _after(lines: Sequence[str], key: str, path: Path) -> list[str]:
    """The lines that follow lines of the form ``key``."""
    found = [lines[n + 1] for n in range(len(lines) - 1) if re.fullmatch(key, lines[n])]
    if not found:
        raise DatasetError(f"{path}: has no line {key!r}; is it the definition file of FBMS-59?")
    return found


def _values(path: Path) -> NDArray[np.uint8]:
    try:
        return read_values(path)
    except FormatError as error:
        raise DatasetError(str(error)) from error
