"""Bodies of rendered clips: what stands where and how it moves, drawn at random.

The unit of length is that of the scene; the camera looks along z, x right, y down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import SettingsError
from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.scene import Camera
from zsmoseg.synthetic.textures import texture

HALF_VIEW = 0.55
"""Half the width of the view over the focal length of rendered scenes."""
WALL, GROUND = 20.0, 1.9
"""Distance of the wall and depth of the ground below the camera, in the unit of the scene."""
MARGIN = 1.15
"""Radii that a mover keeps from the border of the frame."""
WITHIN = 0.9
"""Size of a body over the radius that is kept free for it: turned, it must not show more."""
APART = 1.25
"""Sums of their radii that movers keep from each other."""
EVEN = 1.3
"""Ratio of the fastest to the slowest mover, against the wall, that is not exceeded."""
NEARLY = 0.9
"""Of its speed against what stands still at its depth that a mover has at least against the wall."""
TRIES = 5000
"""Paths drawn before a demand is called impossible."""
COLOURS = ((50, 60, 205), (205, 110, 40), (40, 190, 215), (170, 60, 175), (60, 185, 70))
"""Of the movers, blue green red."""

Pose = tuple[Floats, Floats]
"""Rotation (3, 3) and place (3,) of a body in front of the camera."""
Paths = tuple[Floats, Floats, Floats]
"""Places (movers, T, 3), their depths (movers, T), and radii over half the frame's width (movers,)."""


@dataclass(frozen=True)
class Body:
    """A textured plate: endless with a repeating texture, or with a lobed outline."""

    poses: list[Pose]
    """One a frame."""
    size: float
    """Radius, or half the distance at which the texture repeats, in the unit of the scene."""
    texture: NDArray[np.uint8]
    """(n, n, 3) blue green red."""
    group: int
    """Motion group, 0 = static."""
    endless: bool = False
    """Whether it goes on beyond its radius."""
    lobes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of the outline: depth over the radius, number, rad of the first."""
    sides: tuple[float, float] | None = None
    """Half width and height of a rectangle, in units of ``size``, 1 at most."""
    part: bool = False
    """Whether it is another side of the body before it."""

    def plane(self, lens: Floats, t: int) -> Floats:
        """(3, 3) px from plane coordinates in units of ``size``."""
        turn, place = self.poses[t]
        return lens @ np.stack([turn[:, 0] * self.size, turn[:, 1] * self.size, place], 1)


def about(turn: Any) -> Floats:
    """Rotation (3, 3) by a vector (3,), rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0])


def travel(rng: np.random.Generator, camera: Camera, frames: int) -> list[Pose]:
    """The world's pose relative to the camera at every frame; moderate enough that the shot lasts."""
    turn, shift = np.zeros(3), np.zeros(3)
    side = rng.choice([-1.0, 1.0])
    if camera == "pan":
        turn = np.array([0, side * rng.uniform(0.003, 0.006), rng.normal(0, 0.001)])
    elif camera == "lateral":
        shift[:2] = side * rng.uniform(0.03, 0.05), rng.normal(0, 0.006)
    elif camera == "forward":
        shift[2] = -rng.uniform(0.04, 0.06)
    elif camera == "general":
        shift = np.array([side * rng.uniform(0.02, 0.035), rng.normal(0, 0.004), -rng.uniform(0.015, 0.03)])
        turn = rng.normal(0, 0.0008, 3)
    middle = (frames - 1) / 2
    return [(about(turn * (t - middle)), shift * (t - middle)) for t in range(frames)]


def fixed(world: list[Pose], turn: Floats, place: Floats) -> list[Pose]:
    """Poses of what stands still in the world."""
    return [(r @ turn, r @ place + s) for r, s in world]


def surroundings(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    """The wall and the ground."""
    wall = fixed(world, np.eye(3), np.array([0.0, 0.0, WALL]))
    ground = fixed(world, about([np.pi / 2, 0, 0]), np.array([0.0, GROUND, 8.0]))
    return [
        Body(wall, 6.0, texture(rng, (105, 120, 95), 22), 0, endless=True),
        Body(ground, 4.0, texture(rng, (85, 105, 125), 20), 0, endless=True, part=True),
    ]


def still_body(rng: np.random.Generator, world: list[Pose]) -> Body:
    """Something that stands in the world."""
    z = rng.uniform(9, 16)
    place = np.array([rng.uniform(-0.45, 0.45) * z, rng.uniform(-0.2, 0.08) * z, z])
    size = rng.uniform(0.05, 0.09) * z
    colour = rng.uniform(70, 140, 3)
    return Body(fixed(world, about(rng.normal(0, 0.3, 3)), place), size, texture(rng, colour, 20), 0)


def moving_bodies(rng: np.random.Generator, world: list[Pose], paths: Paths | None) -> list[Body]:
    """Movers on ``paths``, which turn a little."""
    if paths is None:
        return []
    place, depth, radius = paths
    bodies = []
    for k in range(len(place)):
        start, spin = rng.normal(0, 0.25, 3), rng.normal(0, 0.004, 3) * np.array([1, 1, 2])
        poses = [(about(spin * t) @ about(start), place[k, t]) for t in range(len(world))]
        lobes = (rng.uniform(0.0, 0.14), float(rng.integers(2, 5)), rng.uniform(0, 2 * np.pi))
        size = radius[k] * HALF_VIEW * float(depth[k].mean()) * WITHIN
        skin = texture(rng, COLOURS[k % len(COLOURS)], 35)
        bodies.append(Body(poses, size, skin, k + 1, lobes=lobes))
    return bodies


def even_paths(
    rng: np.random.Generator, world: list[Pose], movers: int, aspect: float, speed: float
) -> Paths | None:
    """Straight relative to the camera, drawn until all demands of ``video_scene`` are met.

    Parameters
    ----------
    aspect : height over width of the frame.
    speed : least speed, hundredths of half the frame's width a frame.
    """
    if not movers:
        return None
    frames = len(world)
    for _ in range(TRIES):
        z = rng.uniform(4.0, 5.5, (movers, 2))
        radius = rng.uniform(0.15, 0.2, movers)
        room = np.array([1, aspect]) - MARGIN * radius[:, None, None]
        image = rng.uniform(-1, 1, (movers, 2, 2)) * room
        path = np.linspace(image[:, 0], image[:, 1], frames, axis=1)
        depth = np.linspace(z[:, 0], z[:, 1], frames, axis=1)
        place = _at(path, depth)
        if _demands(world, place, path, radius, speed / 100):
            return place, depth, radius
    raise SettingsError(f"no scene has {movers} movers of speed {speed:g}; ask for fewer or slower ones")


def uneven_paths(
    rng: np.random.Generator, world: list[Pose], speeds: Sequence[float], aspect: float
) -> Paths:
    """Straight on top of what stands still at their depth, each of its own speed against that.

    Parameters
    ----------
    speeds : hundredths of half the frame's width a frame, one for each mover.
    """
    movers = len(speeds)
    path, depth, radius = np.zeros((movers, len(world), 2)), np.zeros((movers, len(world))), np.zeros(movers)
    done: list[int] = []
    for k in np.argsort(speeds)[::-1].tolist():
        for _ in range(TRIES):
            radius[k], depth[k] = rng.uniform(0.15, 0.2), rng.uniform(4.0, 5.5)
            room = np.array([1, aspect]) - MARGIN * radius[k]
            path[k] = _path(
                world, rng.uniform(-1, 1, 2) * room, rng.uniform(0, 2 * np.pi), speeds[k], depth[k]
            )
            place = _at(path[k : k + 1], depth[k : k + 1])
            far = path[k, 1:] - _carried(world, place * (WALL / place[..., 2:]))[0]
            moves = (np.linalg.norm(far, axis=1) >= NEARLY * speeds[k] / 100).all()
            if (
                moves
                and (np.abs(path[k]) <= room).all()
                and _keep_apart(path[[*done, k]], radius[[*done, k]])
            ):
                break
        else:
            raise SettingsError(
                f"no scene has movers of the speeds {tuple(speeds)}; ask for fewer frames or slower ones"
            )
        done.append(k)
    return _at(path, depth), depth, radius


def _path(world: list[Pose], start: Floats, angle: float, speed: float, depth: Floats) -> Floats:
    """(T, 2) from ``start``, half widths: what stands still at the depths (T,), and a step of its own a frame."""
    step = speed / 100 * np.array([np.cos(angle), np.sin(angle)])
    path = [start]
    for t in range(len(world) - 1):
        path.append(_carried(world[t : t + 2], _at(path[-1][None, None], depth[None, :1]))[0, 0] + step)
    return np.stack(path)


def _at(image: Floats, depth: Floats) -> Floats:
    """(..., 3) the points seen at ``image`` (..., 2), in half widths, at a depth (...)."""
    return np.concatenate([image * HALF_VIEW, np.ones((*depth.shape, 1))], -1) * depth[..., None]


def _keep_apart(path: Floats, radius: Floats) -> bool:
    """Whether movers on paths (movers, T, 2) never come near each other."""
    pairs = combinations(range(len(path)), 2)
    return all(
        (np.linalg.norm(path[i] - path[j], axis=1) >= APART * (radius[i] + radius[j])).all() for i, j in pairs
    )


def _demands(world: list[Pose], place: Floats, path: Floats, radius: Floats, speed: float) -> bool:
    """Whether movers keep apart and move by ``speed`` half widths a frame or more.

    They do so against what stands still at their depth, against the wall and against each other, and no
    mover is much faster than another.
    """
    own = path[:, 1:] - _carried(world, place)
    far = path[:, 1:] - _carried(world, place * (WALL / place[..., 2:]))
    if min(np.linalg.norm(v, axis=2).min() for v in (own, far)) < speed:
        return False
    pace = np.linalg.norm(far, axis=2).mean(1)
    if pace.max() > EVEN * pace.min():
        return False
    pairs = combinations(range(len(path)), 2)
    apart = all(np.linalg.norm((own[i] - own[j]).mean(0)) >= speed for i, j in pairs)
    return apart and _keep_apart(path, radius)


def _carried(world: list[Pose], place: Floats) -> Floats:
    """(n, T - 1, 2) where points ``place`` (n, T, 3) would be seen a frame later if they stood still."""
    out = []
    for t in range(len(world) - 1):
        turn = world[t + 1][0] @ world[t][0].T
        moved = (place[:, t] - world[t][1]) @ turn.T + world[t + 1][1]
        out.append(moved[:, :2] / moved[:, 2:] / HALF_VIEW)
    return np.stack(out, 1)
