"""Bodies painted into frames, with exact labels, inverse depth and flow."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.motion.models import Floats
from zsmoseg.synthetic.bodies import HALF_VIEW, Body

BEHIND = 1e-3
"""Inverse depth up to which a point is too far, or behind the camera."""


def lens(shape: tuple[int, int]) -> Floats:
    """(3, 3) px from directions, for frames of a height and a width."""
    height, width = shape
    focal = width / 2 / HALF_VIEW
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def draw(
    body: Body,
    lens: Floats,
    t: int,
    label: int,
    frame: NDArray[np.uint8],
    labels: NDArray[np.uint16],
    inverse: NDArray[np.float32],
) -> None:
    """Paint a body into a frame where it is nearer than what is there.

    Parameters
    ----------
    lens : (3, 3) px from directions.
    t : the frame.
    label : number of the body.
    frame, labels, inverse : (h, w, 3), (h, w) and (h, w) what is there: picture, body, inverse depth.
    """
    plane = body.plane(lens, t)
    x0, y0, x1, y1 = _window(body, plane, frame.shape)
    if x0 >= x1 or y0 >= y1:
        return
    to_plane = np.linalg.inv(plane).astype(np.float32)
    x, y = np.arange(x0, x1, dtype=np.float32)[None, :], np.arange(y0, y1, dtype=np.float32)[:, None]
    q = to_plane[2, 0] * x + to_plane[2, 1] * y + to_plane[2, 2]
    inside = q > np.maximum(inverse[y0:y1, x0:x1], BEHIND)
    if not body.endless:
        safe = np.where(inside, q, 1)
        a, b = ((row[0] * x + row[1] * y + row[2]) / safe for row in to_plane[:2])
        inside &= _within(body, a, b)
    half = len(body.texture) / 2
    texel = np.array([[1 / half, 0, -1], [0, 1 / half, -1], [0, 0, 1]])
    corner = np.array([[1, 0, -x0], [0, 1, -y0], [0, 0, 1.0]])
    size = x1 - x0, y1 - y0
    image = cv2.warpPerspective(body.texture, corner @ plane @ texel, size, borderMode=cv2.BORDER_WRAP)
    mask = inside.astype(np.uint8)
    cv2.copyTo(image, mask, frame[y0:y1, x0:x1])
    labels[y0:y1, x0:x1][inside] = label
    inverse[y0:y1, x0:x1][inside] = q[inside]


def _within(body: Body, a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether plane coordinates lie on a body."""
    if body.sides is not None:
        return np.asarray((np.abs(a) < body.sides[0]) & (np.abs(b) < body.sides[1]))
    depth, count, phase = body.lobes
    return np.asarray(np.hypot(a, b) < 1 + depth * (np.cos(count * np.arctan2(b, a) + phase) - 1))


def _window(body: Body, plane: Floats, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1: where in the frame a body can be."""
    height, width = shape[:2]
    if body.endless:
        return 0, 0, width, height
    corners = plane @ np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, 1, 1, 1.0]])
    if (corners[2] <= BEHIND).any():
        return 0, 0, 0, 0
    at = corners[:2] / corners[2]
    x0, y0 = np.floor(at.min(1)).astype(int)
    x1, y1 = np.ceil(at.max(1)).astype(int) + 1
    return max(int(x0), 0), max(int(y0), 0), min(int(x1), width), min(int(y1), height)


def exact_flow(
    bodies: list[Body], lens: Floats, t: int, label: NDArray[np.uint16], inverse: NDArray[np.float32]
) -> Floats:
    """(2, h, w) where every pixel goes: its point moves with its body.

    Parameters
    ----------
    bodies : by their number; sides of one move alike.
    label, inverse : (h, w) as ``draw`` leaves them.
    """
    y, x = np.mgrid[: label.shape[0], : label.shape[1]]
    ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(lens).T
    flow = np.zeros((2, *label.shape))
    for k, body in enumerate(bodies):
        mine = label == k
        (turn, place), (next_turn, next_place) = body.poses[t : t + 2]
        point = ray[mine] / inverse[mine][:, None]
        moved = (point - place) @ (next_turn @ turn.T).T + next_place
        image = moved / moved[:, 2:] @ lens.T
        flow[0][mine], flow[1][mine] = image[:, 0] - x[mine], image[:, 1] - y[mine]
    return flow
