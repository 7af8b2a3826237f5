"""Things that stand on the ground near the camera: poles, walls across and along the view, boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.bodies import GROUND, HALF_VIEW, Body, Pose, about, fixed
from zsmoseg.synthetic.textures import texture

NEAREST, FARTHEST = 3.5, 9.0
"""Distances at which they stand, in the unit of the scene."""


def near_things(rng: np.random.Generator, world: list[Pose], count: int) -> list[Body]:
    """The plates of some things, drawn at random; a box has three."""
    kinds = (_pole, _wall, _side, _box)
    return [plate for _ in range(count) for plate in kinds[rng.integers(len(kinds))](rng, world)]


def _pole(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    x, z = _place(rng)
    return [_plate(rng, world, np.zeros(3), (x, z), (rng.uniform(0.08, 0.2), rng.uniform(1.2, 2.5)))]


def _wall(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    x, z = _place(rng)
    turn = np.array([0, rng.normal(0, 0.3), 0])
    return [_plate(rng, world, turn, (x, z), (rng.uniform(0.6, 1.5), rng.uniform(0.4, 1.0)))]


def _side(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    x, z = rng.choice([-1, 1]) * rng.uniform(1.2, 2.2), rng.uniform(5.5, FARTHEST)
    turn = np.array([0, np.pi / 2 + rng.normal(0, 0.1), 0])
    return [_plate(rng, world, turn, (x, z), (rng.uniform(0.8, 1.5), rng.uniform(0.6, 1.8)))]


def _box(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    """Its front, the side that is seen, and its top."""
    x, z = _place(rng)
    half, high, deep = rng.uniform(0.25, 0.7), rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.5)
    inner = x - np.sign(x) * half, z + deep
    front = _plate(rng, world, np.zeros(3), (x, z), (half, high))
    side = _plate(rng, world, np.array([0, np.pi / 2, 0]), inner, (deep, high))
    top = _plate(rng, world, np.array([np.pi / 2, 0, 0]), (x, z + deep), (half, deep), 2 * high)
    return [front, replace(side, part=True), replace(top, part=True)]


def _place(rng: np.random.Generator) -> tuple[float, float]:
    """X and z of something that is seen."""
    z = rng.uniform(NEAREST, FARTHEST)
    return rng.uniform(-0.9, 0.9) * HALF_VIEW * z, z


def _plate(
    rng: np.random.Generator,
    world: list[Pose],
    turn: Floats,
    at: tuple[float, float],
    half: tuple[float, float],
    above: float | None = None,
) -> Body:
    """A rectangle that stands on the ground at x and z, or lies ``above`` it."""
    size = max(half)
    place = np.array([at[0], GROUND - (half[1] if above is None else above), at[1]])
    skin = texture(rng, tuple(rng.uniform(60, 150, 3)), 25)
    sides = half[0] / size, half[1] / size
    return Body(fixed(world, about(turn), place), size, skin, 0, sides=sides)
