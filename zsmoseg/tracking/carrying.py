"""Mask propagation: masks of some frames carried along the flow to others.

Mask propagation is a word of Perazzi et al., "Learning video object segmentation from static images", CVPR 2017; here
there is no network: masks are looked up along the flow.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Label = NDArray[np.uint16]
Flow = NDArray[np.float32]

NOWHERE = -1e6
"""A place outside every image, px."""


def here(height: int, width: int) -> Flow:
    """(2, h, w) the place of every pixel itself, x then y, px."""
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)))


def step(where: Flow, flow: Flow) -> Flow:
    """One frame further: where the pixels of this frame lie in the frame that masks are taken from.

    Places are composed and the mask is looked up once: looked up frame by frame it would fray.

    Parameters
    ----------
    where
        (2, h, w) the same for the neighbour that ``flow`` leads to, x then y, px.
    flow
        (2, h, w) from this frame to that neighbour, px; NaN = unknown, which lies nowhere.

    Returns
    -------
    (2, h, w)
    """
    x, y = np.nan_to_num(here(*flow.shape[1:]) + flow, nan=NOWHERE)
    return np.stack(
        [
            cv2.remap(w, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NOWHERE)
            for w in where
        ]
    )


def look_up(label: Label, where: Flow) -> Label:
    """The label at given places.

    Parameters
    ----------
    label
        (H, W).
    where
        (2, h, w) x then y, px of a grid of any size.

    Returns
    -------
    (H, W): 0 where the place is nowhere.
    """
    (height, width), (h, w) = label.shape, where.shape[1:]
    scale = np.array([width / w, height / h], np.float32)[:, None, None]
    x, y = ((where + np.float32(0.5)) * scale - np.float32(0.5)).astype(np.float32)
    if (height, width) != (h, w):
        x, y = (cv2.resize(axis, (width, height), interpolation=cv2.INTER_LINEAR) for axis in (x, y))
    return np.asarray(
        cv2.remap(label, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    )


def nearest_known(known: NDArray[np.bool_], start: int, stop: int) -> NDArray[np.int64]:
    """For each of the frames ``start`` to ``stop - 1`` the nearest known one among them, the earlier of two; -1: none.

    Parameters
    ----------
    known
        (frames of the video).
    start, stop
        Of the shot.

    Returns
    -------
    (stop - start)
    """
    frames = np.arange(start, stop)
    some = frames[known[start:stop]]
    if not len(some):
        return np.full(len(frames), -1)
    return np.asarray(some[np.abs(frames[:, None] - some).argmin(1)])
