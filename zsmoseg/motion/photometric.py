"""Whether the motion of an object shows in the image at all.

Flow is a guess where there is no texture. What moves by itself is explained worse by the motion of the static world
than by its own flow: its pixels, looked up where the world's motion would have them in the next frame, have other
grey values there. A flat patch of road has the same ones.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.fit import fit
from zsmoseg.motion.models import BASIS, MODELS, Floats, coordinates

Image = NDArray[np.float32]
BLUR = 1.0
"""px, against noise and against flow that is right to a fraction of a pixel only."""


def grey(frame: NDArray[np.uint8]) -> Image:
    """(h, w) smoothed grey values of a frame (h, w, 3)."""
    return np.asarray(
        cv2.GaussianBlur(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), BLUR), np.float32
    )


def world_motion(gram: Floats, frame: Floats, shape: tuple[int, int]) -> Image:
    """(2, h, w) px: the quadratic motion (paper, equation 2) of the background with the Gram ``gram`` (11, 11).

    Parameters
    ----------
    frame : (11, 11) the Gram of the whole frame.
    shape : (h, w).
    """
    model = MODELS["quadratic"]
    theta = fit(gram[None], model, frame)[0]
    x, y = np.meshgrid(*coordinates(*shape))
    zero = np.zeros_like(x)
    phi = np.stack([np.ones_like(x), x, y, zero, zero, zero, x * x, x * y, y * y], -1)
    assert phi.shape[-1] == BASIS
    return np.stack([phi @ (model.rows_u @ theta), phi @ (model.rows_v @ theta)]).astype(np.float32)


def unexplained(a: Image, b: Image, flow: Image) -> Image:
    """(h, w) squared difference of ``a`` (h, w) and what ``flow`` (2, h, w) px finds for it in ``b``, grey levels^2."""
    height, width = a.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    found = cv2.remap(b, x + flow[0], y + flow[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray((found - a) ** 2, np.float32)


def explained(
    a: Image,
    b: Image,
    flow: NDArray[np.float32],
    world: Image,
    slot: NDArray[np.int32],
    count: int,
) -> Floats:
    """(count, 2) per object: what the world's motion leaves unexplained, and what the flow does, grey levels^2 x px.

    Parameters
    ----------
    a, b : (h, w) smoothed grey values of both frames of the pair.
    flow, world : (2, h, w) px.
    slot : (h, w) object of every pixel; below 0 counts for nothing.
    """
    used = slot >= 0
    return np.stack(
        [np.bincount(slot[used], unexplained(a, b, f)[used], count) for f in (world, flow)], axis=1
    )
