"""Label images: palette, grey or black-and-white files as integers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from zsmoseg.errors import FormatError


def read_labels(path: Path) -> NDArray[np.integer[Any]]:
    """The labels of an image, (H, W), unsigned.

    Raises
    ------
    FormatError
        Not an image, damaged, or in colour without a palette (equal channels are taken as grey).
    """
    values = read_values(path)
    if values.ndim == 3:
        colour = values[..., : values.shape[2] - 1] if values.shape[2] in (2, 4) else values
        if (colour != colour[..., :1]).any():
            raise FormatError(
                f"{path}: is a colour image; labels are expected (a palette or grey PNG, value = id)"
            )
        values = np.ascontiguousarray(colour[..., 0])
    if values.dtype == np.bool_:
        return values.astype(np.uint8)
    if not np.issubdtype(values.dtype, np.integer):
        raise FormatError(f"{path}: holds {values.dtype} values; labels are whole numbers")
    return values


def read_values(path: Path) -> NDArray[Any]:
    """The values of an image as they are: (H, W) ids of a palette or grey image, (H, W, channels) of a colour one."""
    try:
        with Image.open(path) as image:
            return np.asarray(image)
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError) as error:
        raise FormatError(f"{path}: cannot be read as an image ({error})") from error
