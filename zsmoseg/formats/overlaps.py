"""Masks of one frame that may overlap, as one image of numbers; what every source of masks offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.video.bounds import BYTES

HIGHEST = 65535
"""Of ids: labels are stored in 16 bits."""


@dataclass(frozen=True)
class FrameMasks:
    """The masks of one frame.

    Parameters
    ----------
    label
        (H, W) uint16: the id, or the number 1.. within the frame, of the mask on top; 0 = none.
    hidden
        Pixels of masks that lie under another one.
    score
        (K,) float32, entry ``k`` that of the label ``k + 1``, NaN where it has none; None without scores.
    left_out
        What of the file is not in them: how many of what, in words.
    """

    label: NDArray[np.uint16]
    hidden: int = 0
    score: NDArray[np.float32] | None = None
    left_out: Counter[str] = field(default_factory=Counter)


class MaskSource(ABC):
    """The masks of one video.

    Parameters
    ----------
    path
        What errors begin with.
    frames
        Names of the frames that have masks; None where the file knows only their order.
    count
        Number of entries.
    size
        (H, W) of all of them.
    ids
        Whether labels are ids over the whole video; else numbers within each frame.

    Attributes
    ----------
    left_out
        What of the file belongs to no frame: how many of what, in words.
    notes
        How the file was understood where that is not plain.
    """

    def __init__(
        self, path: Path, frames: list[str] | None, count: int, size: tuple[int, int], ids: bool
    ) -> None:
        self.path, self.frames, self.count, self.size, self.ids = path, frames, count, size, ids
        self.left_out: Counter[str] = Counter()
        self.notes: list[str] = []

    @property
    def entries(self) -> Sequence[str] | range | int:
        """What ``match_frames`` wants: names, or the number of entries."""
        return self.count if self.frames is None else self.frames

    def read(self, entry: int | str) -> FrameMasks:
        """The masks of one entry, by its index or by the name of its frame.

        Raises
        ------
        FormatError
            If they cannot be used; the message names file and frame.
        """
        return self._read(entry if isinstance(entry, int) else index_of(self.frames, entry, self.path))

    @abstractmethod
    def _read(self, index: int) -> FrameMasks: ...


def index_of(frames: Sequence[str] | None, name: str, where: Path) -> int:
    """The index of a frame by name."""
    if name not in (frames or ()):
        raise FormatError(f"{where}: has no frame {name}")
    return list(frames or ()).index(name)


def stack(
    masks: Sequence[NDArray[np.bool_]],
    size: tuple[int, int],
    numbers: Sequence[int] | None = None,
    scores: Sequence[float] | None = None,
    left_out: Counter[str] | None = None,
) -> FrameMasks:
    """Lay masks on each other: the higher score on top; without scores the smaller one.

    Parameters
    ----------
    masks : (H, W) each.
    numbers : label of each, 1.. in order where not given.
    scores : of each; of equal ones (and areas) the lower number is on top.
    left_out : see ``FrameMasks``.
    """
    given = list(range(1, len(masks) + 1)) if numbers is None else list(numbers)
    areas = [int(np.count_nonzero(mask)) for mask in masks]
    height = scores if scores is not None else [-area for area in areas]
    label = np.zeros(size, np.uint16)
    for k in sorted(range(len(masks)), key=lambda k: (height[k], -given[k])):
        label[masks[k]] = given[k]
    by_label = None
    if scores is not None:
        by_label = np.full(max(given, default=0), np.nan, np.float32)
        by_label[[n - 1 for n in given]] = scores
    return FrameMasks(label, sum(areas) - int(np.count_nonzero(label)), by_label, left_out or Counter())


def refuse_many(count: int, size: tuple[int, int], where: str, highest: int = 0) -> None:
    """Raise ``FormatError`` if the masks of one frame are too many to lay on each other, or to number.

    Parameters
    ----------
    count, size : of the masks of the frame, (H, W).
    highest : number that is given to one of them.
    """
    if max(count, highest) > HIGHEST or count * size[0] * size[1] > 2 * BYTES:
        raise FormatError(
            f"{where}: has {count} masks of {text(size)}, the highest number is {max(count, highest)}; at most "
            f"{HIGHEST}, and {2 * BYTES / 1e9:.1f} GB of one frame, are read"
        )


def as_ids(values: NDArray[Any], size: tuple[int, int], where: str) -> NDArray[np.uint16]:
    """Check an image of ids (H, W) and give it as uint16; ``where`` begins the errors."""
    if values.shape != size:
        raise FormatError(
            f"{where}: is {text(values.shape)}, the first frame {text(size)}; give all in one size"
        )
    if values.dtype.kind not in "bui":
        raise FormatError(
            f"{where}: holds {values.dtype} numbers; ids are whole numbers, save them as uint16"
        )
    low, high = int(values.min(initial=0)), int(values.max(initial=0))
    if low < 0 or high > HIGHEST:
        raise FormatError(
            f"{where}: holds the id {low if low < 0 else high}; ids go from 1 to {HIGHEST}, 0 = none"
        )
    return values.astype(np.uint16)


def left_out_words(left_out: Mapping[str, int]) -> str:
    """What was left out, how many of each: goes on with a sentence; nothing where nothing was."""
    found = ", ".join(f"{what} ({count})" for what, count in sorted(left_out.items()) if count)
    return f"; left out: {found}" if found else ""


def text(size: Sequence[int]) -> str:
    """A size in words."""
    return " x ".join(map(str, size))
