"""Scenes with known camera motion, depth and motion of every object: the ground truth of the tests.

``flow_scene``
    Labels, exact instantaneous flow (equation 1 of the paper) with noise, and inverse depth known up to
    scale and shift; no picture.
``video_scene``
    Textured bodies, a wall and a ground rendered frame by frame under finite motions, with labels, inverse
    depth and exact flow: real optical flow works on it.
``demo_scene``
    The clip of ``zsmoseg demo``.

Object 0 is the background. All lengths are px of the scene's own grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg import rendering
from zsmoseg.motion.loops import gram_matrices
from zsmoseg.motion.models import MODELS, Floats, coordinates, normalise
from zsmoseg.motion.residuals import LEAST, merge_costs
from zsmoseg.rendering import Camera

CAMERAS: tuple[Camera, ...] = ("still", "pan", "lateral", "forward", "general")

FASTEST = 60.0
"""px a frame that no flow scene exceeds."""
SHOWN = 48
"""px below which an object is too small for a scene's truth to ask for it."""


@dataclass(frozen=True)
class Scene:
    """One synthetic shot of T frames and N objects (0 = background)."""

    labels: NDArray[np.uint16]
    """(T, H, W) object of every pixel."""
    flow: NDArray[np.float32]
    """(T - 1, 2, H, W) px, x then y, to the next frame."""
    inverse_depth: NDArray[np.float32]
    """(T, H, W), up to scale (and shift)."""
    group: NDArray[np.int64]
    """(N,) true motion group, 0 = static."""
    moving: NDArray[np.bool_]
    """(T - 1, N) whether an object moves at a pair."""
    contrast: Floats
    """(N,) rms px of an object's flow that no single motion shares with the background."""
    camera: Camera
    frames: NDArray[np.uint8] | None = None
    """(T, H, W, 3) blue green red, if rendered."""

    @property
    def objects(self) -> int:
        """Number of objects, the background included."""
        return len(self.group)

    @property
    def truth(self) -> NDArray[np.int64]:
        """(T, H, W) true motion group of every pixel, 0 = static."""
        return self.group[self.labels]

    @property
    def pictures(self) -> NDArray[np.uint8]:
        """(T, H, W, 3) the frames; of a scene that was not rendered every object in a colour of its own."""
        if self.frames is not None:
            return self.frames
        palette = np.random.default_rng(0).integers(0, 256, (self.objects, 3), np.uint8)
        return palette[self.labels]

    def right(self, group: NDArray[np.integer[Any]]) -> tuple[bool, bool]:
        """Whether groups (N,) are the true ones but for names, and whether static and moving are.

        Objects with fewer than ``SHOWN`` px in all frames, or all but one, are not asked for.
        """
        pixels = np.stack([np.bincount(label.ravel(), minlength=self.objects) for label in self.labels[:-1]])
        shown = (pixels >= SHOWN).sum(0) >= 2
        found, true = group[shown], self.group[shown]
        both = bool(((found > 0) == (true > 0)).all())
        names = set(zip(found.tolist(), true.tolist(), strict=True))
        return both and len(names) == len(np.unique(found)) == len(np.unique(true)), both


@dataclass(frozen=True)
class Motion:
    """Motion per frame of a body relative to the camera: a point X moves by ``turn`` x X + ``shift``."""

    turn: Floats
    shift: Floats


def rigid_flow(
    x: Floats, y: Floats, inverse_depth: Floats, focal: float, motion: Motion
) -> tuple[Floats, Floats]:
    """Instantaneous flow u, v of a rigid body, px (paper, equation 1; Longuet-Higgins and Prazdny 1980).

    Parameters
    ----------
    x, y : px from the principal point.
    inverse_depth : 1 / z, in the inverse of the unit of ``motion.shift``.
    focal : px.
    """
    w, t = motion.turn, motion.shift
    u = -x * y / focal * w[0] + (focal**2 + x * x) / focal * w[1] - y * w[2]
    v = -(focal**2 + y * y) / focal * w[0] + x * y / focal * w[1] + x * w[2]
    return u + (focal * t[0] - x * t[2]) * inverse_depth, v + (focal * t[1] - y * t[2]) * inverse_depth


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], sigma: float) -> Floats:
    """Noise (h, w) of mean 0 and variance 1 with a Gaussian correlation of ``sigma`` px."""
    step = max(int(sigma / 2), 1)
    rows, columns = shape[0] // step + 8, shape[1] // step + 8
    field = cv2.GaussianBlur(rng.normal(size=(rows, columns)), (0, 0), sigma / step)
    field = cv2.resize(field, (columns * step, rows * step), interpolation=cv2.INTER_LINEAR)
    field = field[4 * step :, 4 * step :][: shape[0], : shape[1]]
    return np.asarray((field - field.mean()) / max(float(field.std()), 1e-12))


# ---------------------------------------------------------------------- flow scenes
def flow_scene(
    seed: int,
    n_movers: int | None = None,
    n_objects: int | None = None,
    camera: Camera | None = None,
    noise: float = 0.1,
    n_pairs: int = 8,
    shape: tuple[int, int] = (240, 426),
    depth_shift: bool = True,
    depth_noise: float = 0.0,
    min_contrast: float = 0.75,
    stop: bool = False,
    companions: float = 0.3,
    leak: int = 0,
) -> Scene:
    """A random scene: a wall and a ground, objects with relief in front of them, 0 to 3 motions.

    Parameters
    ----------
    seed : the scene.
    n_movers : independent motions; None: 0 to 3.
    n_objects : proposals, the background apart; None: 3 to 25.
    camera : None: any of ``CAMERAS``.
    noise : px rms of the flow's error, half of its variance white, half correlated over 6 px.
    n_pairs : frame pairs.
    shape : height and width.
    depth_shift : inverse depth is known up to scale and shift, else up to scale.
    depth_noise : relative rms of a smooth error of inverse depth.
    min_contrast : px rms by which a mover differs from the best single motion for it together with the
        background, and from every other mover; else motions, then layout, are drawn again: what nothing
        could tell apart is not asked for.
    stop : the movers move in the first half of the pairs only.
    companions : probability that a motion is shared by two objects.
    leak : px by which every mask is dilated.
    """
    rng = np.random.default_rng(seed)
    n_movers = int(rng.integers(0, 4)) if n_movers is None else n_movers
    n_objects = int(rng.integers(max(3, 2 * n_movers), 26)) if n_objects is None else n_objects
    camera = CAMERAS[int(rng.integers(len(CAMERAS)))] if camera is None else camera
    layout = _layout(rng, shape, n_objects, n_movers, companions)
    static = _camera_motion(rng, camera)
    phase = rng.uniform(0, 2 * np.pi, (n_movers + 1, 2))[:, 0]
    scale, shift = rng.uniform(0.2, 5), rng.uniform(-0.5, 1.5) if depth_shift else 0.0
    for attempt in range(60):
        motions = [static, *_own_motions(rng, layout, static, n_movers, attempt)]
        scene = _play(layout, motions, phase, n_pairs, stop)
        contrast, clear = _contrast(scene, min_contrast)
        if clear:
            break
    else:
        again = seed + 1_000_003
        return flow_scene(
            again, n_movers, n_objects, camera, noise, n_pairs, shape, depth_shift, depth_noise, min_contrast,
            stop, companions, leak,
        )  # fmt: skip
    flow = scene.flow + _flow_noise(rng, scene.flow.shape, noise)
    observed = scale * (scene.inverse_depth + shift * scene.inverse_depth.mean())
    if depth_noise:
        observed *= [1 + depth_noise * smooth_noise(rng, shape, 25) for _ in observed]
    labels = np.stack([_dilate(label, leak) for label in scene.labels]) if leak else scene.labels
    return Scene(
        labels,
        flow.astype(np.float32),
        observed.astype(np.float32),
        layout.group,
        scene.moving,
        contrast,
        camera,
    )


@dataclass(frozen=True)
class _Layout:
    """What stands where at the first frame; rows of objects 1.. (object 0 apart, but for ``group``)."""

    focal: float
    back: Floats
    centre: Floats
    radius: Floats
    inverse: Floats
    slope: Floats
    bumps: list[Floats]
    angle: Floats
    group: NDArray[np.int64]

    @property
    def order(self) -> NDArray[np.int64]:
        """Painting order: movers last, so that they are seen."""
        return np.argsort(self.group[1:] > 0, kind="stable")


@dataclass(frozen=True)
class _Played:
    labels: NDArray[np.uint16]
    flow: NDArray[np.floating]
    inverse_depth: NDArray[np.floating]
    group: NDArray[np.int64]
    moving: NDArray[np.bool_]


def _grid(shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """x, y (h, w) px from the image centre."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2


def _layout(
    rng: np.random.Generator, shape: tuple[int, int], n: int, movers: int, companions: float
) -> _Layout:
    height, width = shape
    focal = width * rng.uniform(0.7, 1.3)
    wall = 1 / rng.uniform(15, 40)
    horizon, camera_height = rng.uniform(-0.2, 0.1) * height, rng.uniform(1.0, 3.0)
    ground = (_grid(shape)[1] - horizon) / (focal * camera_height)
    relief = 1 + 0.15 * smooth_noise(rng, shape, 30)
    back = np.maximum(wall * (1 + 0.2 * smooth_noise(rng, shape, 40)), ground * relief)
    layout = _Layout(
        focal,
        np.clip(back, 1 / 60, 1 / 2),
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
    rng: np.random.Generator, layout: _Layout, movers: int, companions: float, width: int, height: int
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


def _camera_motion(rng: np.random.Generator, camera: Camera) -> Motion:
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


def _own_motions(
    rng: np.random.Generator, layout: _Layout, static: Motion, movers: int, attempt: int
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


def _play(layout: _Layout, motions: Sequence[Motion], phase: Floats, pairs: int, stop: bool) -> _Played:
    """Move the objects along their own flow; speeds vary by 30 % over the shot."""
    shape = layout.back.shape
    height, width = shape
    x, y = _grid((height, width))
    labels = np.zeros((pairs + 1, height, width), np.uint16)
    inverse = np.zeros(labels.shape)
    flow = np.zeros((pairs, 2, height, width))
    moving = np.zeros((pairs, len(layout.group)), np.bool_)
    at = layout.centre.copy()
    for m in range(pairs + 1):
        labels[m], inverse[m] = _still(layout, at, x, y)
        if m == pairs:
            break
        wobble = 1 + 0.3 * np.sin(2 * np.pi * m / 12 + phase)
        for g in range(len(motions)):
            active = g > 0 and not (stop and m >= pairs // 2)
            motion = _mixed(motions[0], motions[g], wobble[0], wobble[g]) if active else motions[0]
            motion = motion if active else Motion(motion.turn * wobble[0], motion.shift * wobble[0])
            mine = layout.group[labels[m]] == g
            flow[m][:, mine] = rigid_flow(x[mine], y[mine], inverse[m][mine], layout.focal, motion)
            moving[m, layout.group == g] = active
            for k in np.flatnonzero(layout.group[1:] == g):
                at[k] += np.array(rigid_flow(at[k, 0], at[k, 1], layout.inverse[k], layout.focal, motion))
    return _Played(labels, flow, inverse, layout.group, moving)


def _mixed(static: Motion, own: Motion, of_camera: float, of_mover: float) -> Motion:
    """The camera's part of a mover's motion follows the camera's speed, the rest its own."""
    turn = static.turn * of_camera + (own.turn - static.turn) * of_mover
    return Motion(turn, static.shift * of_camera + (own.shift - static.shift) * of_mover)


def _still(layout: _Layout, at: Floats, x: Floats, y: Floats) -> tuple[NDArray[np.uint16], Floats]:
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
        inverse[inside] = np.clip(layout.inverse[k] * relief, 1 / 60, 1)
    return label, inverse


def _flow_noise(rng: np.random.Generator, shape: tuple[int, ...], noise: float) -> Any:
    if noise == 0:
        return 0.0
    white = rng.normal(size=shape)
    soft = [[smooth_noise(rng, (shape[2], shape[3]), 6) for _ in range(2)] for _ in range(shape[0])]
    return noise * np.sqrt(0.5) * (white + np.array(soft))


def _dilate(label: NDArray[np.uint16], radius: int) -> NDArray[np.uint16]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1,) * 2)
    out = label.copy()
    for n in np.unique(label[label > 0])[::-1]:
        grown = cv2.dilate((label == n).astype(np.uint8), kernel) > 0
        out[grown & (label == 0)] = n
    return out


def _contrast(scene: _Played, least: float) -> tuple[Floats, bool]:
    """(N,) rms px against the background, and whether every mover is clear of it and of every other mover.

    Judged by the exact model, ``screw-shift``, on every second pixel of the exact data. All that does not
    move at a pair is the background.
    """
    n = len(scene.group)
    total, count = np.zeros((n, n)), np.zeros((n, n))
    height, width = scene.labels.shape[1:]
    x, y = (axis[::2] for axis in coordinates(height, width))
    for m, moving in enumerate(scene.moving):
        slot = np.where(moving[scene.labels[m]], scene.labels[m], 0)[::2, ::2].astype(np.int32)
        q = normalise(scene.inverse_depth[m][::2, ::2])
        gram = gram_matrices(slot, x, y, q, scene.flow[m, 0][::2, ::2], scene.flow[m, 1][::2, ::2], n)
        seen = np.flatnonzero(gram[:, 0, 0] >= LEAST)
        d, _ = merge_costs(gram[seen], MODELS["screw-shift"], gram.sum(0))
        total[np.ix_(seen, seen)] += d
        count[np.ix_(seen, seen)] += 1
    rms = np.sqrt(total / np.maximum(count, 1))
    movers = scene.group > 0
    resting = ~scene.moving.all(0)
    limit = np.where(resting, np.sqrt(0.5), 1.0)[:, None] * least
    other = movers[:, None] & ((scene.group[:, None] != scene.group) & movers | (np.arange(n) == 0))
    enough = count[0, movers] >= scene.moving[:, movers].sum(0) / 2
    speed = np.sqrt((scene.flow**2).sum(1)).max()
    return rms[0], bool((rms >= limit)[other].all() and enough.all() and speed < FASTEST)


# ------------------------------------------------------------------ rendered scenes
def video_scene(
    seed: int,
    n_movers: int = 2,
    n_objects: int = 6,
    camera: Camera = "lateral",
    n_frames: int = 48,
    shape: tuple[int, int] = (480, 854),
    speed: float = 1.0,
    exact: bool = True,
) -> Scene:
    """A rendered shot: textured bodies before a wall and a ground, finite motions, exact truth.

    Movers stay inside the frame, in front of everything, apart from each other, and move by themselves by
    at least ``speed`` hundredths of half the frame's width a frame, all about equally
    fast. About 40 ms a frame without ``exact``.

    Parameters
    ----------
    seed : the scene.
    n_movers : movers, each with a screw motion of its own.
    n_objects : static bodies that count as objects.
    camera : its motion.
    n_frames : frames.
    shape : height and width, px.
    speed : of the movers.
    exact : false leaves flow and contrast out (zeros).
    """
    rng = np.random.default_rng(seed)
    height, width = shape
    lens = rendering.lens(shape)
    world = rendering.travel(rng, camera, n_frames)
    bodies = [
        *rendering.surroundings(rng, world),
        *[rendering.still_body(rng, world) for _ in range(n_objects)],
        *rendering.moving_bodies(rng, world, n_movers, height / width, speed),
    ]
    frames = np.zeros((n_frames, height, width, 3), np.uint8)
    labels = np.zeros((n_frames, height, width), np.uint16)
    inverse = np.zeros((n_frames, height, width), np.float32)
    flow = np.zeros((n_frames - 1, 2, height, width), np.float32)
    for t in range(n_frames):
        for k, body in enumerate(bodies):
            rendering.draw(body, lens, t, max(k - 1, 0), frames[t], labels[t], inverse[t])
        frames[t] = cv2.GaussianBlur(frames[t], (0, 0), 0.6)
        if exact and t + 1 < n_frames:
            flow[t] = rendering.exact_flow(bodies, lens, t, labels[t], inverse[t])
    group = np.array([0, *(body.group for body in bodies[2:])], np.int64)
    moving = np.tile(group > 0, (n_frames - 1, 1))
    contrast = np.zeros(len(group))
    if exact:
        contrast, _ = _contrast(_Played(labels, flow, inverse, group, moving), 0.0)
    return Scene(labels, flow, inverse, group, moving, contrast, camera, frames)


def demo_scene(seed: int = 0) -> Scene:
    """The clip of the demo: 48 frames of 480 x 854, two movers, a camera that moves sideways and forward."""
    return video_scene(seed, n_movers=2, n_objects=4, camera="general", exact=False)
