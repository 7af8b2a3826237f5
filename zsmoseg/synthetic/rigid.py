"""Rigid motions: of the camera, of what moves by itself, and the flow they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.arrangement import Arrangement
from zsmoseg.synthetic.scene import Camera


@dataclass(frozen=True)
class Motion:
    """Motion per frame of a body relative to the camera: a point X moves by ``turn`` x X + ``shift``."""

    turn: Floats
    """(3,) rad."""
    shift: Floats
    """(3,) in the unit of the scene."""


def rigid_flow(
    x: Floats, y: Floats, inverse_depth: Floats, focal: float, motion: Motion
) -> tuple[Floats, Floats]:
    """Instantaneous flow u, v of a rigid body, px (paper, equation 1; Longuet-Higgins, Prazdny 1980).

    Parameters
    ----------
    x, y : px from the principal point.
    inverse_depth : 1 / z, in the inverse of the unit of ``motion.shift``.
    focal : px.
    motion : of the body relative to the camera.
    """
    w, t = motion.turn, motion.shift
    u = -x * y / focal * w[0] + (focal**2 + x * x) / focal * w[1] - y * w[2]
    v = -(focal**2 + y * y) / focal * w[0] + x * y / focal * w[1] + x * w[2]
    return u + (focal * t[0] - x * t[2]) * inverse_depth, v + (focal * t[1] - y * t[2]) * inverse_depth


def camera_motion(rng: np.random.Generator, camera: Camera) -> Motion:
    """Motion of the world relative to the camera, for depths of 5 to 20."""
    turn, shift = np.zeros(3), np.zeros(3)
    if camera == "pan":
        turn = rng.normal(0, 0.012, 3)
    elif camera == "lateral":
        direction = rng.normal(size=2)
        shift[:2] = direction / np.linalg.norm(direction) * rng.uniform(0.06, 0.2)
        turn = rng.normal(0, 0.003, 3)
    elif camera == "forward":
        shift = np.array([rng.normal(0, 0.02), rng.normal(0, 0.02), -rng.uniform(0.15, 0.5)])
        turn = rng.normal(0, 0.003, 3)
    elif camera == "general":
        shift = rng.normal(0, 0.1, 3) * np.array([1, 1, 2])
        turn = rng.normal(0, 0.008, 3)
    return Motion(turn, shift)


def own_motions(
    rng: np.random.Generator, layout: Arrangement, static: Motion, movers: int, attempt: int
) -> list[Motion]:
    """A screw motion per mover about its own place, faster with every attempt."""
    out = []
    for g in range(1, movers + 1):
        lead = int(np.flatnonzero(layout.group[1:] == g)[0])
        speed = rng.uniform(0.05, 0.25) * (1 + 0.3 * attempt / 10)
        direction = rng.normal(size=3) * np.array([1, 0.6, 1])
        spin = rng.normal(0, 0.02, 3)
        place = np.append(layout.centre[lead] / layout.focal, 1) / layout.inverse[lead]
        drift = direction / np.linalg.norm(direction) * speed - np.cross(spin, place)
        out.append(Motion(static.turn + spin, static.shift + drift))
    return out


def mixed(static: Motion, own: Motion, of_camera: float, of_mover: float) -> Motion:
    """The camera's part of a mover's motion follows the camera's speed, the rest its own."""
    turn = static.turn * of_camera + (own.turn - static.turn) * of_mover
    return Motion(turn, static.shift * of_camera + (own.shift - static.shift) * of_mover)
