"""Superpixels of one frame: small connected regions of one colour on a nearly regular grid.

Source: Achanta, Shaji, Smith, Lucchi, Fua, Süsstrunk, "SLIC superpixels compared to state-of-the-art superpixel
methods", PAMI 2012; here a pixel looks only at the centres of the 3 x 3 grid cells around its own.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import kernels, settings
from zsmoseg.errors import SettingsError

MOST = 65535
"""Most superpixels that a frame can have: they are stored in 16 bits."""


def segment(frame: NDArray[np.uint8], s: settings.Segments) -> NDArray[np.uint16]:
    """Superpixels of one frame.

    Parameters
    ----------
    frame
        (h, w, 3), blue green red.
    s
        The section ``segments`` of the settings.

    Returns
    -------
    (h, w): the superpixel of each pixel, 0 to n - 1, every one connected and not empty.

    Raises
    ------
    SettingsError
        The frame would have more than 65535 superpixels.
    """
    height, width = frame.shape[:2]
    if round(height / s.pitch) * round(width / s.pitch) > MOST // 2:
        raise SettingsError(
            f"segments.pitch = {s.pitch:g}: too many superpixels in {width} x {height} px; "
            f"use {np.sqrt(2 * height * width / MOST):.1f} or more"
        )
    clusters = kernels.slic(lab(frame), s.pitch, s.compactness, s.passes)
    pieces = kernels.connected(clusters, height * width // (4 * (int(clusters.max()) + 1)))
    return np.asarray(pieces, np.uint16)


def lab(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    """CIE Lab (L 0 to 100) of a frame (h, w, 3), blurred by 3 x 3 px."""
    colour = cv2.cvtColor(frame.astype(np.float32) / np.float32(255), cv2.COLOR_BGR2LAB)
    return np.asarray(cv2.GaussianBlur(colour, (3, 3), 0), np.float32)
