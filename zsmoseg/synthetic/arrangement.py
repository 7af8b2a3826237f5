"""What stands where in a flow scene: a wall and a ground, and ellipses with relief in front of them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.textures import smooth_noise

FARTHEST, FAR_GROUND, NEAREST = 1 / 60, 1 / 2, 1.0
"""Inverse depth of what is farthest, of the nearest ground, and of what is nearest, in the unit of the scene."""


@dataclass(frozen=True)
class Arrangement:
    """What stands where at the first frame; rows of objects 1.. (object 0 apart, but for ``group``)."""

    focal: float
    """px."""
    back: Floats
    """(h, w) inverse depth of wall and ground."""
    centre: Floats
    """(n, 2) x, y px from the image centre."""
    radius: Floats
    """(n, 2) half axes of the ellipses, px."""
    inverse: Floats
    """(n,) inverse depth."""
    slope: Floats
    """(n, 2) relative change of inverse depth per px in x and y."""
    bumps: list[Floats]
    """(h, w) each, relief that objects share in turn, relative."""
    angle: Floats
    """(n,) of the ellipses, rad."""
    group: NDArray[np.int64]
    """(n + 1,) motion group, 0 = static."""

    @property
    def order(self) -> NDArray[np.int64]:
        """Painting order: movers last, so that they are seen."""
        return np.argsort(self.group[1:] > 0, kind="stable")


def centred_grid(shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """x, y (h, w) px from the image centre."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2


def arrange(
    rng: np.random.Generator, shape: tuple[int, int], n: int, movers: int, companions: float
) -> Arrangement:
    """A random arrangement of ``n`` objects in a frame (height, width), the first of them in ``movers`` motions.

    Parameters
    ----------
    companions : probability that a motion is shared by two objects.
    """
    height, width = shape
    focal = width * rng.uniform(0.7, 1.3)
    wall = 1 / rng.uniform(15, 40)
    horizon, camera_height = rng.uniform(-0.2, 0.1) * height, rng.uniform(1.0, 3.0)
    ground = (centred_grid(shape)[1] - horizon) / (focal * camera_height)
    relief = 1 + 0.15 * smooth_noise(rng, shape, 30)
    back = np.maximum(wall * (1 + 0.2 * smooth_noise(rng, shape, 40)), ground * relief)
    layout = Arrangement(
        focal,
        np.clip(back, FARTHEST, FAR_GROUND),
        np.stack([rng.uniform(-0.45, 0.45, n) * width, rng.uniform(-0.45, 0.45, n) * height], 1),
        np.stack([rng.uniform(0.03, 0.12, n) * width, rng.uniform(0.05, 0.2, n) * height], 1),
        1 / rng.uniform(3, 15, n),
        rng.normal(0, 0.25, (n, 2)) / focal,
        [0.05 * smooth_noise(rng, shape, 12) for _ in range(min(n, 6))],
        rng.uniform(0, np.pi, n),
        np.zeros(n + 1, np.int64),
    )
    _choose_movers(rng, layout, movers, companions, width, height)
    return layout


def _choose_movers(
    rng: np.random.Generator, layout: Arrangement, movers: int, companions: float, width: int, height: int
) -> None:
    """Give the first objects their motion groups; companions stand side by side at about the same depth."""
    n, group, following = len(layout.centre), layout.group, 1
    for g in range(1, movers + 1):
        size = 2 if rng.random() < companions and following + 1 + (movers - g) < n else 1
        group[following : following + size] = g
        following += size
    for g in range(1, movers + 1):
        ids = np.flatnonzero(group[1:] == g)
        layout.radius[ids] = np.maximum(layout.radius[ids], [0.05 * width, 0.09 * height])
        if len(ids) == 2:
            lead, other = ids
            side = 1 if layout.centre[lead, 0] < 0 else -1
            layout.centre[other] = layout.centre[lead] + [2.2 * layout.radius[lead, 0] * side, 0]
            layout.radius[other] = layout.radius[lead]
            layout.inverse[other] = layout.inverse[lead] * rng.uniform(0.8, 1.25)


def stand(layout: Arrangement, at: Floats, x: Floats, y: Floats) -> tuple[NDArray[np.uint16], Floats]:
    """Labels and inverse depth (h, w) with the objects at ``at``."""
    label, inverse = np.zeros(x.shape, np.uint16), layout.back.copy()
    for k in layout.order:
        dx, dy = x - at[k, 0], y - at[k, 1]
        c, s = np.cos(layout.angle[k]), np.sin(layout.angle[k])
        a, b = layout.radius[k]
        inside = ((c * dx + s * dy) / a) ** 2 + ((c * dy - s * dx) / b) ** 2 < 1
        label[inside] = k + 1
        bump = layout.bumps[k % len(layout.bumps)][inside]
        relief = 1 + layout.slope[k, 0] * dx[inside] + layout.slope[k, 1] * dy[inside] + bump
        inverse[inside] = np.clip(layout.inverse[k] * relief, FARTHEST, NEAREST)
    return label, inverse


def dilated(label: NDArray[np.uint16], radius: int) -> NDArray[np.uint16]:
    """Labels (h, w) grown by ``radius`` px into the background; where two meet, the lower number wins."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1,) * 2)
    out = label.copy()
    for n in np.unique(label[label > 0])[::-1]:
        grown = cv2.dilate((label == n).astype(np.uint8), kernel) > 0
        out[grown & (label == 0)] = n
    return out
