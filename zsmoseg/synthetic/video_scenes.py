"""Clips rendered with bodies whose motion is known, as PNG folders and truth."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from zsmoseg.synthetic.bodies import (
    Body,
    Paths,
    even_paths,
    moving_bodies,
    still_body,
    surroundings,
    travel,
    uneven_paths,
)
from zsmoseg.synthetic.contrast import Played, contrast_of
from zsmoseg.synthetic.near_things import near_things
from zsmoseg.synthetic.render import draw, exact_flow, lens
from zsmoseg.synthetic.scene import Camera, Scene
from zsmoseg.synthetic.wishes import check_camera, check_number, check_shape, check_whole

MOST = 10_000
"""Bodies of a kind: labels have 16 bits."""
SOFT = 0.6
"""px, standard deviation of the blur of the lens: without it edges are sharper than any camera's."""


def video_scene(
    seed: int,
    n_movers: int = 2,
    n_objects: int = 6,
    camera: Camera = "lateral",
    n_frames: int = 48,
    shape: tuple[int, int] = (480, 854),
    speed: float = 1.0,
    exact: bool = True,
    speeds: Sequence[float] = (),
    n_near: int = 0,
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
    speeds : one for each mover in the place of ``n_movers`` and ``speed``, against what stands still at its depth.
    n_near : static things near the camera that stand on the ground: poles, walls, boxes.

    Raises
    ------
    SettingsError
        An argument out of range; no scene has so many movers, so fast.
    """
    check_whole("seed", seed, 0)
    for name, count in (("n_movers", n_movers), ("n_objects", n_objects), ("n_near", n_near)):
        check_whole(name, count, 0, MOST)
    check_whole("n_frames", n_frames, 2)
    check_shape(shape)
    check_camera(camera)
    for one in (speed, *speeds):
        check_number("a speed", one)
    rng = np.random.default_rng(seed)
    world = travel(rng, camera, n_frames)
    aspect = shape[0] / shape[1]
    still = [*surroundings(rng, world), *[still_body(rng, world) for _ in range(n_objects)]]
    still += near_things(rng, world, n_near)
    paths: Paths | None
    if speeds:
        paths = uneven_paths(rng, world, speeds, aspect)
    else:
        paths = even_paths(rng, world, n_movers, aspect, speed)
    return _rendered([*still, *moving_bodies(rng, world, paths)], n_frames, shape, camera, exact)


def _rendered(bodies: list[Body], count: int, shape: tuple[int, int], camera: Camera, exact: bool) -> Scene:
    """The scene of some bodies; the first is the background."""
    whole = [body for body in bodies if not body.part]
    number = np.cumsum([not body.part for body in bodies]) - 1
    glass, (height, width) = lens(shape), shape
    frames = np.zeros((count, height, width, 3), np.uint8)
    labels = np.zeros((count, height, width), np.uint16)
    inverse = np.zeros((count, height, width), np.float32)
    flow = np.zeros((count - 1, 2, height, width), np.float32)
    for t in range(count):
        for k, body in zip(number.tolist(), bodies, strict=True):
            draw(body, glass, t, k, frames[t], labels[t], inverse[t])
        frames[t] = cv2.GaussianBlur(frames[t], (0, 0), SOFT)
        if exact and t + 1 < count:
            flow[t] = exact_flow(whole, glass, t, labels[t], inverse[t])
    group = np.array([body.group for body in whole], np.int64)
    moving = np.tile(group > 0, (count - 1, 1))
    contrast = np.zeros(len(group))
    if exact:
        contrast, _ = contrast_of(Played(labels, flow, inverse, group, moving), 0.0)
    return Scene(labels, flow, inverse, group, moving, contrast, camera, frames)


def demo_scene(seed: int = 0) -> Scene:
    """The clip of the demo: 48 frames of 480 x 854, two movers, a camera that moves sideways and forward."""
    return video_scene(seed, n_movers=2, n_objects=4, camera="general", exact=False)
