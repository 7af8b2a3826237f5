"""Pixels that count for nothing: the mask of them as people see it, and whether it fits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ImageOps

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.video import places
from zsmoseg.video.bounds import BadHead, open_image
from zsmoseg.video.pixels import JPEG, pixels

Bools = NDArray[np.bool_]
LEVELS = 16
"""Levels of grey up to which an image holds marks, each of which counts; more may be shades, whose dark half is black."""
SOLID = 0.5
"""Share of what is dark and not black from which it is marks if it lies in areas of one value: shades and noise have none."""
LEAST = 0.01
"""Share of a frame that must be left."""


def read_ignore(path: str, height: int, width: int) -> Bools:
    """(height, width) true where the image ``path`` shows something, resized to the nearest.

    Raises
    ------
    SettingsError
        If it cannot be read.
    """
    mask = _shown(path)[0].astype(np.uint8)
    return np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0)


def describe_ignore(path: str, height: int, width: int) -> str:
    """What a mask ignores of frames of this size, in words.

    Raises
    ------
    SettingsError
        If it cannot be read, has another shape, or leaves nothing.
    """
    mask, shades = _shown(path)
    rows, columns = mask.shape
    if (
        abs(columns * height - rows * width) > max(height + width, rows + columns) / 2
    ):  # beyond what rounding makes
        raise SettingsError(
            f"{path}: the ignore mask is {columns} x {rows}, the frames are {width} x {height}; give one of that size, or "
            "of a scale of it, to --ignore"
        )
    share = float(mask.mean())
    if 1 - share < LEAST:
        raise SettingsError(
            f"{path}: the ignore mask leaves {_percent(1 - share)} of the frame; what is not black in it is ignored: "
            "give the opposite to --ignore"
        )
    scaled = "" if mask.shape == (height, width) else f", scaled from {columns} x {rows}"
    rule = ", of its shades what is brighter than half" if shades else ""
    return f"ignored: {_percent(share)} of every frame ({Path(path).name}{scaled}{rule})"


def _percent(share: float) -> str:
    """A share that is not nothing is not told as nothing."""
    return "nothing" if not share else f"{100 * share:.3g} %"


def _shown(path: str) -> tuple[Bools, bool]:
    """Where a mask shows something: what is not transparent, and of that what is not black, if some is black and some not.

    Also whether what is darker than half was taken for black.
    """
    try:
        image = None if places.special(path) else pixels(path)
    except VideoError as error:
        if isinstance(cause := error.__cause__, OSError) and cause.strerror:
            raise SettingsError(f"{path}: the ignore mask cannot be read ({cause.strerror})") from error
        if isinstance(cause, BadHead):
            raise SettingsError(f"{path}: the ignore mask {cause}; give a PNG to --ignore") from error
        image = None
    if image is None:
        raise SettingsError(f"{path}: the ignore mask cannot be read as an image; give a PNG to --ignore")
    grey = image.max(axis=2)
    shades = _has_shades(path, grey)
    bright = np.asarray(grey > (_middle(grey) if shades else 0))
    visible = _visible(path)
    if visible is None or not visible.any():
        return (bright, shades) if visible is None else (visible, False)
    told = bright[visible].any() and not bright[visible].all()
    return (visible & bright, shades) if told or visible.all() else (visible, False)


def _visible(path: str) -> Bools | None:
    """Where an image is not transparent; None where it cannot be."""
    with open_image(path) as image:
        if not image.has_transparency_data:
            return None
        alpha = np.asarray((ImageOps.exif_transpose(image) or image).convert("RGBA").getchannel("A"))
    return np.asarray(alpha > _middle(alpha))


def _has_shades(path: str, grey: NDArray[Any]) -> bool:
    """Whether black is noisy: JPEG makes it so, and what was made from one; edges that are soft are shades too."""
    with Path(path).open("rb") as file:
        if file.read(len(JPEG)) == JPEG:
            return True
    if len(np.unique(grey)) <= LEVELS:
        return False
    around = np.ones((3, 3), np.uint8)
    solid = cv2.dilate((cv2.erode(grey, around) == cv2.dilate(grey, around)).astype(np.uint8), around) > 0
    dark = (grey > 0) & (grey <= _middle(grey))
    marked = solid[dark].mean() >= SOLID if dark.any() else False
    return not (marked and (solid & (grey == 0)).mean() >= LEAST)


def _middle(values: NDArray[Any]) -> float:
    return float(values.max()) / 2
