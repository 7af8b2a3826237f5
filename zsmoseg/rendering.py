"""Rendering of synthetic clips: textured bodies that move rigidly in front of a camera, with exact truth.

The unit of length is that of the scene; the camera looks along z, x right, y down. What stands where and how it
moves is drawn at random; ``zsmoseg.synthetic`` offers the finished scenes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats

Camera = Literal["still", "pan", "lateral", "forward", "general"]

HALF_VIEW = 0.55
"""Half the width of the view over the focal length of rendered scenes."""
WALL, GROUND = 20.0, 1.9
"""Distance of the wall and depth of the ground below the camera, in the unit of the scene."""
MARGIN = 1.15
"""Radii that a mover keeps from the border of the frame."""

Pose = tuple[Floats, Floats]
"""Rotation (3, 3) and place (3,) of a body in front of the camera."""


@dataclass(frozen=True)
class Body:
    """A textured plate: endless with a repeating texture, or with a lobed outline."""

    poses: list[Pose]
    size: float
    texture: NDArray[np.uint8]
    group: int
    endless: bool = False
    lobes: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def plane(self, lens: Floats, t: int) -> Floats:
        """(3, 3) px from plane coordinates in units of ``size``."""
        turn, place = self.poses[t]
        return lens @ np.stack([turn[:, 0] * self.size, turn[:, 1] * self.size, place], 1)


def lens(shape: tuple[int, int]) -> Floats:
    """(3, 3) px from directions, for frames of a height and a width."""
    height, width = shape
    focal = width / 2 / HALF_VIEW
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


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


def _fixed(world: list[Pose], turn: Floats, place: Floats) -> list[Pose]:
    """Poses of what stands still in the world."""
    return [(r @ turn, r @ place + s) for r, s in world]


def surroundings(rng: np.random.Generator, world: list[Pose]) -> list[Body]:
    """The wall and the ground."""
    wall = _fixed(world, np.eye(3), np.array([0.0, 0.0, WALL]))
    ground = _fixed(world, about([np.pi / 2, 0, 0]), np.array([0.0, GROUND, 8.0]))
    return [
        Body(wall, 6.0, _texture(rng, (105, 120, 95), 22), 0, endless=True),
        Body(ground, 4.0, _texture(rng, (85, 105, 125), 20), 0, endless=True),
    ]


def still_body(rng: np.random.Generator, world: list[Pose]) -> Body:
    """Something that stands in the world."""
    z = rng.uniform(9, 16)
    place = np.array([rng.uniform(-0.45, 0.45) * z, rng.uniform(-0.2, 0.08) * z, z])
    size = rng.uniform(0.05, 0.09) * z
    colour = rng.uniform(70, 140, 3)
    return Body(_fixed(world, about(rng.normal(0, 0.3, 3)), place), size, _texture(rng, colour, 20), 0)


COLOURS = ((50, 60, 205), (205, 110, 40), (40, 190, 215), (170, 60, 175), (60, 185, 70))
"""Of the movers, blue green red."""


def moving_bodies(
    rng: np.random.Generator, world: list[Pose], movers: int, aspect: float, speed: float
) -> list[Body]:
    """Movers on straight paths relative to the camera, drawn until all demands of ``video_scene`` are met."""
    frames = len(world)
    if not movers:
        return []
    for _ in range(5000):
        z = rng.uniform(4.0, 5.5, (movers, 2))
        radius = rng.uniform(0.15, 0.2, movers)
        room = np.array([1, aspect]) - MARGIN * radius[:, None, None]
        image = rng.uniform(-1, 1, (movers, 2, 2)) * room
        path = np.linspace(image[:, 0], image[:, 1], frames, axis=1)
        depth = np.linspace(z[:, 0], z[:, 1], frames, axis=1)
        place = np.concatenate([path * HALF_VIEW, np.ones((movers, frames, 1))], 2) * depth[..., None]
        if _demands(world, place, path, radius, speed / 100):
            break
    else:
        raise ValueError(f"no scene has {movers} movers of speed {speed:g}; ask for fewer or slower ones")
    bodies = []
    for k in range(movers):
        start, spin = rng.normal(0, 0.25, 3), rng.normal(0, 0.004, 3) * np.array([1, 1, 2])
        poses = [(about(spin * t) @ about(start), place[k, t]) for t in range(frames)]
        lobes = (rng.uniform(0.0, 0.14), float(rng.integers(2, 5)), rng.uniform(0, 2 * np.pi))
        size = radius[k] * HALF_VIEW * float(depth[k].mean()) * 0.9
        texture = _texture(rng, COLOURS[k % len(COLOURS)], 35)
        bodies.append(Body(poses, size, texture, k + 1, lobes=lobes))
    return bodies


EVEN = 1.3
"""Ratio of the fastest to the slowest mover, against the wall, that is not exceeded."""


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
    for i in range(len(path)):
        for j in range(i):
            if (np.linalg.norm(path[i] - path[j], axis=1) < 1.25 * (radius[i] + radius[j])).any():
                return False
            if np.linalg.norm((own[i] - own[j]).mean(0)) < speed:
                return False
    return True


def _carried(world: list[Pose], place: Floats) -> Floats:
    """(n, T - 1, 2) where points ``place`` (n, T, 3) would be seen a frame later if they stood still."""
    out = []
    for t in range(len(world) - 1):
        turn = world[t + 1][0] @ world[t][0].T
        moved = (place[:, t] - world[t][1]) @ turn.T + world[t + 1][1]
        out.append(moved[:, :2] / moved[:, 2:] / HALF_VIEW)
    return np.stack(out, 1)


def _texture(
    rng: np.random.Generator, colour: Sequence[float] | Floats, strength: float
) -> NDArray[np.uint8]:
    """A picture (384, 384, 3) with detail at three scales around one colour, to be repeated both ways."""
    size = 384
    out = np.zeros((size, size, 3))
    for sigma, amount in ((3, 0.6), (9, 1.0), (25, 1.0)):
        shared = _endless_noise(rng, size, sigma)
        for c in range(3):
            out[..., c] += strength * amount * (0.9 * shared + 0.2 * _endless_noise(rng, size, sigma))
    picture: NDArray[np.uint8] = np.clip(out + np.asarray(colour), 0, 255).astype(np.uint8)
    return picture


def _endless_noise(rng: np.random.Generator, size: int, sigma: float) -> Floats:
    """Noise of variance 1 whose left and right, upper and lower edges fit."""
    frequency = np.fft.fftfreq(size)
    square = frequency[:, None] ** 2 + frequency[None, :] ** 2
    spectrum = np.fft.fft2(rng.normal(size=(size, size))) * np.exp(-2 * (np.pi * sigma) ** 2 * square)
    field = np.fft.ifft2(spectrum).real
    return np.asarray((field - field.mean()) / max(float(field.std()), 1e-12))


def draw(
    body: Body,
    lens: Floats,
    t: int,
    label: int,
    frame: NDArray[np.uint8],
    labels: NDArray[np.uint16],
    inverse: NDArray[np.float32],
) -> None:
    """Paint a body into a frame where it is nearer than what is there."""
    plane = body.plane(lens, t)
    x0, y0, x1, y1 = _window(body, plane, frame.shape)
    if x0 >= x1 or y0 >= y1:
        return
    to_plane = np.linalg.inv(plane).astype(np.float32)
    x, y = np.arange(x0, x1, dtype=np.float32)[None, :], np.arange(y0, y1, dtype=np.float32)[:, None]
    q = to_plane[2, 0] * x + to_plane[2, 1] * y + to_plane[2, 2]
    inside = q > np.maximum(inverse[y0:y1, x0:x1], 1e-3)
    if not body.endless:
        safe = np.where(inside, q, 1)
        a, b = ((row[0] * x + row[1] * y + row[2]) / safe for row in to_plane[:2])
        depth, count, phase = body.lobes
        inside &= np.hypot(a, b) < 1 + depth * (np.cos(count * np.arctan2(b, a) + phase) - 1)
    half = len(body.texture) / 2
    texel = np.array([[1 / half, 0, -1], [0, 1 / half, -1], [0, 0, 1]])
    corner = np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, 1.0]])
    size = x1 - x0, y1 - y0
    image = cv2.warpPerspective(body.texture, corner @ plane @ texel, size, borderMode=cv2.BORDER_WRAP)
    mask = inside.astype(np.uint8)
    cv2.copyTo(image, mask, frame[y0:y1, x0:x1])
    labels[y0:y1, x0:x1][inside] = label
    inverse[y0:y1, x0:x1][inside] = q[inside]


def _window(body: Body, plane: Floats, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1: where in the frame a body can be."""
    height, width = shape[:2]
    if body.endless:
        return 0, 0, width, height
    corners = plane @ np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, 1, 1, 1.0]])
    if (corners[2] <= 1e-3).any():
        return 0, 0, 0, 0
    at = corners[:2] / corners[2]
    x0, y0 = np.floor(at.min(1)).astype(int)
    x1, y1 = np.ceil(at.max(1)).astype(int) + 1
    return max(int(x0), 0), max(int(y0), 0), min(int(x1), width), min(int(y1), height)


def exact_flow(
    bodies: list[Body], lens: Floats, t: int, label: NDArray[np.uint16], inverse: NDArray[np.float32]
) -> Floats:
    """(2, h, w) where every pixel goes: its point moves with its body."""
    y, x = np.mgrid[: label.shape[0], : label.shape[1]]
    ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(lens).T
    flow = np.zeros((2, *label.shape))
    for k, body in enumerate(bodies[1:]):
        mine = label == k
        (turn, place), (next_turn, next_place) = body.poses[t : t + 2]
        point = ray[mine] / inverse[mine][:, None]
        moved = (point - place) @ (next_turn @ turn.T).T + next_place
        image = moved / moved[:, 2:] @ lens.T
        flow[0][mine], flow[1][mine] = image[:, 0] - x[mine], image[:, 1] - y[mine]
    return flow
