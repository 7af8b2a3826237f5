"""Optical flow between two frames, and whether two frames are a pair at all.

Source of the flow: Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV 2016, as
implemented in OpenCV.
"""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings

PairState = Literal["ok", "cut", "repeat"]


def between(
    a: NDArray[np.uint8], b: NDArray[np.uint8], s: settings.Flow
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Dense flow from ``a`` to ``b`` and from ``b`` to ``a``.

    Parameters
    ----------
    a, b
        Frames (h, w, 3), blue green red.
    s
        The section ``flow`` of the settings.

    Returns
    -------
    forward, backward
        (2, h, w) each, x then y, in px: the pixel (x, y) of ``a`` is at (x, y) + forward[:, y, x] in ``b``.
    """
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(s.finest_scale)
    dis.setPatchStride(s.stride)
    dis.setGradientDescentIterations(s.descent)
    dis.setVariationalRefinementIterations(s.refinement)
    first, second = (cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in (a, b))
    there, back = dis.calc(first, second, None), dis.calc(second, first, None)  # type: ignore[call-overload]
    return _planar(there), _planar(back)


def _planar(flow: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.moveaxis(flow, 2, 0), np.float32)


def resized(flow: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """A flow (2, H, W) on a grid of another (height, width), in px of that grid; NaN = unknown.

    A pixel is known where half of what it is the mean of is.
    """
    if flow.shape[1:] == shape:
        return flow
    scale = np.array([shape[1] / flow.shape[2], shape[0] / flow.shape[1]], np.float32)[:, None, None]
    known = np.asarray(np.isfinite(flow).all(axis=0))

    def shrunk(x: NDArray[Any]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(x, shape[::-1], interpolation=cv2.INTER_AREA), np.float32)

    part = shrunk(known.astype(np.float32))
    sums = np.stack([shrunk(np.asarray(np.nan_to_num(axis) * known)) for axis in flow])
    return np.asarray(
        np.where(part >= 0.5, sums * scale / np.maximum(part, np.float32(0.5)), np.nan), np.float32
    )


def inverted(flow: NDArray[np.float32], rounds: int = 8) -> NDArray[np.float32]:
    """The flow back, from the flow there (2, h, w): the fixed point of back(p) = -there(p + back(p)).

    Where the flow folds, one of the pixels that come to a place is taken.
    """
    y, x = np.mgrid[: flow.shape[1], : flow.shape[2]].astype(np.float32)
    back = -flow
    for _ in range(rounds):
        u, v = np.nan_to_num(back)
        back = -np.stack(
            [cv2.remap(f, x + u, y + v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for f in flow]
        )
    return np.asarray(back, np.float32)


def pair_state(
    a: NDArray[np.uint8],
    b: NDArray[np.uint8],
    forward: NDArray[np.float32],
    backward: NDArray[np.float32],
    s: settings.Flow,
) -> PairState:
    """Whether two frames are a pair (``ok``), of different shots (``cut``), or the same frame twice (``repeat``).

    Parameters
    ----------
    a, b
        Frames (h, w, 3), blue green red.
    forward, backward
        Their flow, as ``between`` gives it.
    s
        The section ``flow`` of the settings.
    """
    if _repeated(a, b, s.repeat):
        return "repeat"
    lost = _unexplained(a, b, forward, backward) > s.cut and _unexplained(b, a, backward, forward) > s.cut
    return "cut" if lost else "ok"


def _repeated(a: NDArray[np.uint8], b: NDArray[np.uint8], level: float) -> bool:
    """Whether windows of 7 x 7 px differ in their mean by ``level`` at most; 1 in 1000 by twice that.

    Noise and the traces of a codec vanish in the mean, a small thing that moves does not.
    """
    first, second = (cv2.blur(cv2.cvtColor(x, cv2.COLOR_BGR2GRAY).astype(np.float32), (7, 7)) for x in (a, b))
    difference = np.abs(first - second)
    largest = float(difference.max())
    return largest <= level or (largest <= 2 * level and float((difference > level).mean()) <= 0.001)


def _unexplained(
    a: NDArray[np.uint8], b: NDArray[np.uint8], flow: NDArray[np.float32], reverse: NDArray[np.float32]
) -> float:
    """Share of the pixels of ``a`` that the flow takes to another colour and does not bring back.

    Both are asked for: a flash changes colours but not where things go, and flow is lost in fast motion on one
    colour. Looked at on a quarter of the grid.
    """
    height, width = (max(1, n // 4) for n in a.shape[:2])
    first, second, (u, v), (back_u, back_v) = (
        _shrunk(x, (width, height)) for x in (a, b, np.moveaxis(flow, 0, 2), np.moveaxis(reverse, 0, 2))
    )
    y, x = np.mgrid[:height, :width].astype(np.float32)
    to_x, to_y = x + u / 4, y + v / 4
    there, back_u, back_v = (
        cv2.remap(part, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for part in (np.moveaxis(second, 0, 2), back_u, back_v)
    )
    lost = np.hypot(u + back_u, v + back_v) > np.maximum(1, 0.2 * np.hypot(u, v))
    lost |= (to_x < 0) | (to_x > width - 1) | (to_y < 0) | (to_y > height - 1)
    limit = np.clip(0.25 * first.std(), 4, 12)
    return float((lost & (np.abs(np.moveaxis(first, 0, 2) - there).max(2) > limit)).mean())


def _shrunk(image: NDArray[Any], size: tuple[int, int]) -> NDArray[np.float32]:
    """(channels, h, w) of an image (h, w, channels) at another width and height."""
    small = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)
    return np.moveaxis(small.astype(np.float32), 2, 0)


STATES: tuple[PairState, ...] = ("ok", "cut", "repeat")
"""A pair's state is stored as its place here."""
CUT, REPEAT = 1, 2
"""Places in ``STATES``."""
