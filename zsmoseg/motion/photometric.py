"""Whether the motion of an object shows in the image at all.

Flow is a guess where there is no texture. What moves by itself is explained worse by the motion of the static world
than by its own flow: its pixels, looked up where the world's motion would have them in the next frame, have other
grey values there. A flat patch of road has the same ones.

Brightness constancy: Horn, Schunck, "Determining optical flow", Artificial Intelligence 1981.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.consistency import Flow
from zsmoseg.flow.warp import read_at
from zsmoseg.motion.fit import fit
from zsmoseg.motion.models import MODELS, MONOMIALS, Floats, coordinates

Image = NDArray[np.float32]
BLUR = 1.0
"""px, standard deviation: against noise and against flow that is right to a fraction of a pixel only."""


def grey(frame: NDArray[np.uint8]) -> Image:
    """(h, w) smoothed grey values of a frame (h, w, 3)."""
    return np.asarray(
        cv2.GaussianBlur(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), BLUR), np.float32
    )


def world_motion(gram: Floats, frame: Floats) -> Floats:
    """(2, 6): the quadratic motion (paper, equation 2) of the background with the Gram ``gram`` (11, 11), px.

    Factors of 1, x, y, x^2, x y, y^2 for u and v; coordinates as in ``models.coordinates``.

    Parameters
    ----------
    frame : (11, 11) the Gram of the whole frame.
    """
    model = MODELS["quadratic"]
    theta = fit(gram[None], model, frame)[0]
    without_depth = [MONOMIALS.index(name) for name in ("1", "x", "y", "xx", "xy", "yy")]
    return np.stack([model.rows_u @ theta, model.rows_v @ theta])[:, without_depth]


def unexplained(
    first: Image, second: Image, forward: Flow, world: Floats, slot: NDArray[np.int32], count: int
) -> Floats:
    """(count, 2) per object: what the world's motion leaves unexplained, and what the flow does, grey levels^2 x px.

    Parameters
    ----------
    first, second : (h, w) smoothed grey values of both frames of the pair, as ``grey`` gives them.
    forward : (2, h, w) px; NaN = unknown, which counts for nothing.
    world : (2, 6) as ``world_motion`` gives it.
    slot : (h, w) object of every pixel; the background and what is below 0 are left out.
    """
    rows, columns = np.flatnonzero((slot > 0).any(1)), np.flatnonzero((slot > 0).any(0))
    if not len(rows):
        return np.zeros((count, 2))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    x, y = (axis.astype(np.float32) for axis in coordinates(*slot.shape))
    one, x, y = np.float32(1), x[None, box[1]], y[box[0], None]
    by_world = [
        sum(c * m for c, m in zip(f, (one, x, y, x * x, x * y, y * y), strict=True))
        for f in world.astype(np.float32)
    ]
    inside = (slot[box] > 0) & np.isfinite(forward[0][box]) & np.isfinite(forward[1][box])
    sums = [
        np.bincount(slot[box][inside], _error(first[box], second, moved, box)[inside], count)
        for moved in (np.stack(by_world), np.nan_to_num(forward[:, *box]))
    ]
    return np.stack(sums, axis=1)


def _error(part: Image, second: Image, flow: Flow, box: tuple[slice, slice]) -> Image:
    """Squared difference of ``part`` and what ``flow`` (2, of the box) finds for it in ``second``."""
    x = np.arange(box[1].start, box[1].stop, dtype=np.float32)[None]
    y = np.arange(box[0].start, box[0].stop, dtype=np.float32)[:, None]
    return np.asarray((read_at(second, x + flow[0], y + flow[1]) - part) ** 2, np.float32)
