"""Masks as one PNG a frame whose pixel values are ids: palette or grey, 8 or 16 bits (DAVIS)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from zsmoseg.errors import FormatError
from zsmoseg.formats.arrays import DAMAGED, damaged
from zsmoseg.formats.layers import FrameMasks, MaskSource, as_ids, refuse_binary, text

IDS = ("P", "L", "1", "I", "I;16", "I;16B")
"""Pillow's modes of images whose values are numbers, not colours."""


class IndexedFolder(MaskSource):
    """A folder of PNG files named like the frames; sizes and kinds are checked when it is opened."""

    def __init__(self, folder: Path, files: list[Path]) -> None:
        size = image_size(files[0])
        for file in files[1:]:
            if image_size(file) != size:
                raise FormatError(
                    f"{file}: is {text(image_size(file))}, {files[0].name} {text(size)}; give all in one size"
                )
        super().__init__(folder, [file.stem for file in files], len(files), size, ids=True)
        self._files = files
        refuse_binary((str(file), self._read(i).label) for i, file in enumerate(files))

    def _read(self, index: int) -> FrameMasks:
        file = self._files[index]
        return FrameMasks(as_ids(read_numbers(file), self.size, str(file)))


def image_size(path: Path) -> tuple[int, int]:
    """(H, W) of an image of numbers, from its head.

    Raises
    ------
    FormatError
        If it is damaged, or an image of colours.
    """
    try:
        with Image.open(path) as image:
            mode, size = image.mode, (image.height, image.width)
    except DAMAGED as error:
        raise damaged(path, error) from error
    if mode not in IDS:
        raise FormatError(
            f"{path}: is an image of colours ({mode}); ids are expected: save it with a palette, or in grey"
        )
    return size


def read_numbers(path: Path) -> NDArray[Any]:
    """(H, W) the numbers of an image: of a palette image the indices, not the colours."""
    image_size(path)
    try:
        with Image.open(path) as image:
            return np.asarray(image)
    except DAMAGED as error:
        raise damaged(path, error) from error
