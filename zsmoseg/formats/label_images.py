"""Label images: palette, grey or black-and-white files whose pixel values are ids (DAVIS), for imports and truth alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats.npy import DAMAGED
from zsmoseg.video.bounds import open_image

NUMBERS = ("P", "L", "1", "I", "I;16", "I;16B")
"""Pillow's modes of images whose values are numbers, not colours."""


def read_labels(path: Path) -> NDArray[np.integer[Any]]:
    """The labels of an image, (H, W), unsigned.

    Raises
    ------
    FormatError
        Not an image, damaged, no whole numbers, or in colour without a palette (equal channels are grey).
    """
    values = read_numbers(path)
    if values.dtype == np.bool_:
        return values.astype(np.uint8)
    if not np.issubdtype(values.dtype, np.integer):
        raise FormatError(f"{path}: holds {values.dtype} values; labels are whole numbers")
    return values


def read_numbers(path: Path) -> NDArray[Any]:
    """(H, W) the numbers of an image: of a palette image the indices; of equal channels one.

    Raises
    ------
    FormatError
        Not an image, damaged, or in colour.
    """
    values = one_channel(read_values(path))
    if values is None:
        raise FormatError(
            f"{path}: is a colour image; ids are expected: save it with a palette, or in grey (value = id)"
        )
    return values


def one_channel(values: NDArray[Any]) -> NDArray[Any] | None:
    """(H, W) of an image with or without channels; None where they differ. Alpha does not count."""
    if values.ndim == 2:
        return values
    colour = values[..., : values.shape[2] - 1] if values.shape[2] in (2, 4) else values
    return None if (colour != colour[..., :1]).any() else np.ascontiguousarray(colour[..., 0])


def read_values(path: Path, shown: bool = False) -> NDArray[Any]:
    """The values of an image as they are: (H, W), of a colour image (H, W, channels); ``shown``: colours for a palette.

    Raises
    ------
    FormatError
        Not an image, or damaged.
    """
    try:
        with open_image(path) as image:
            return np.asarray(image.convert("RGB") if shown and image.mode == "P" else image)
    except DAMAGED as error:
        raise _no_image(path, error) from error


def image_size(path: Path) -> tuple[int, int]:
    """(H, W) of an image of numbers, from its head; what may be in colour is read.

    Raises
    ------
    FormatError
        As ``read_numbers``; damage after the head is not seen.
    """
    try:
        with open_image(path) as image:
            mode, size = image.mode, (image.height, image.width)
    except DAMAGED as error:
        raise _no_image(path, error) from error
    if mode not in NUMBERS:
        read_numbers(path)
    return size


def _no_image(path: Path, error: Exception) -> FormatError:
    return FormatError(
        f"{path}: cannot be read as an image ({str(error) or type(error).__name__}); make the file anew"
    )
