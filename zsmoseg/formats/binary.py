"""Masks of 0 and 255 where ids are expected, with sharp borders or soft ones: told by how their greys lie."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError

WHITE = (255, 65535)
"""What is on in a binary mask of 8 and of 16 bits."""
NEAR = 0.9
"""Of white: the lightest grey of a mask that became soft."""
LEVELS = 24
"""Different greys of a frame from which a soft mask is one however dark: a few ids may lie around each other."""
SOFT = 0.5
"""Share of the greys that lie between a darker and a lighter pixel beside them; of ids hardly any does."""
BESIDE = np.ones((3, 3), np.uint8)


def refuse_binary(images: Iterable[tuple[str, NDArray[np.uint16]]]) -> None:
    """Raise ``FormatError`` if the images are one mask of black and white each; looks no further than needed.

    Parameters
    ----------
    images : where and (H, W) of each frame.
    """
    first, lightest, soft, levels = "", 0, False, 0
    for where, image in images:
        top = int(image.max(initial=0))
        if not top:
            continue
        grey = (image > 0) & (image != top)
        if grey.any():
            between = (cv2.erode(image, BESIDE) < image) & (image < cv2.dilate(image, BESIDE))
            if np.count_nonzero(between & grey) <= SOFT * np.count_nonzero(grey):
                return
            soft, levels = True, max(levels, len(np.unique(image[grey])))
        elif top not in WHITE:
            return
        first, lightest = first or where, max(lightest, top)
    if levels >= LEVELS or any(NEAR * white <= lightest <= white for white in WHITE):
        what = (
            f"greys between 0 and {lightest}, as a mask with a soft border has"
            if soft
            else f"only 0 and {lightest}"
        )
        raise FormatError(
            f"{first}: holds {what}, as all frames do: a binary mask, where ids are expected; "
            "number the objects 1, 2, ... (1 for all that is white if it is one object)"
        )
