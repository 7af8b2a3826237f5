"""The motion of the camera in each frame, and what superpixels do beyond it.

Source of the fit: iteratively re-weighted least squares (Holland, Welsch 1977) with weights of the form of Geman,
McClure 1987, whose influence falls to 0: a mover is left out rather than compromised with.
"""

# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.compiling import compiled
from zsmoseg.proposals.embedded.aliases import Floats, Ints
from zsmoseg.proposals.embedded.features_loops import ERROR, U, V
from zsmoseg.proposals.embedded.graph import Graph, reliability

Motion = tuple[Floats, Floats]
"""(superpixels, 2) each: x, y forward, and backward, px."""

TERMS = 6
"""Of a quadratic field: 1, x, y, xx, xy, yy. It holds what a plane or a rotation gives."""
RIDGE, RIDGE_LEAST = 1e-5, 0.1
"""Regularisation of a fit over its sum of weights, and the px that sum counts at least: a frame without any is 0."""
MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
BINS = 128
"""Of a histogram of residuals; two of them, one in a bin of the other, find a median to 1 / 16384 of the largest."""


@dataclass(frozen=True)
class Camera:
    """The fit of the camera's motion."""

    camera_rounds: int
    """Rounds of the re-weighted fit."""
    scale_least: float = 0.1
    """Residuals up to about this are noise of the flow, however well the rest fits, px."""


def own_motion(graph: Graph, weight: Floats, camera: Camera) -> Motion:
    """What the flow is beyond the camera's motion, px.

    The camera's motion is a quadratic field of the place, fitted in each frame and direction by itself.

    Parameters
    ----------
    weight
        (superpixels) px that count as background; what has no flow does not, and has no own motion.
    """
    weight = weight * graph.has_flow
    height, width = graph.shape
    y, x = ((graph.place - [height / 2, width / 2]) / (width / 2)).T
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], 1)

    def beyond(flow: Floats) -> Floats:
        observed = np.ascontiguousarray(flow[:, [U, V]])
        field = fit_fields(graph.offset, basis, observed, weight, camera)
        left = observed - np.einsum("nk,nkc->nc", basis, field[graph.frame])
        return np.where(graph.has_flow[:, None], left, 0.0)

    return beyond(graph.forward), beyond(graph.backward)


def speed(graph: Graph, own: Motion) -> Floats:
    """(superpixels) length of the own motion, px: mean of both directions by their ``reliability``."""
    weights = [reliability(flow[:, ERROR]) for flow in (graph.forward, graph.backward)]
    forward, backward = (weight * np.hypot(*motion.T) for weight, motion in zip(weights, own, strict=True))
    return np.asarray((forward + backward) / (weights[0] + weights[1]), np.float64)


def fit_fields(offset: Ints, basis: Floats, flow: Floats, weight: Floats, camera: Camera) -> Floats:
    """Robust fits of a flow, frame by frame.

    Parameters
    ----------
    offset
        (F + 1) first superpixel of each frame.
    basis, flow, weight
        (superpixels, 6); (superpixels, 2) x, y, px; (superpixels).

    Returns
    -------
    (F, 6, 2): coefficients of x and y.
    """
    current = weight = np.ascontiguousarray(weight)
    for _ in range(camera.camera_rounds):
        normal, right = normal_equations(offset, basis, flow, current)
        ridge = RIDGE * (normal[:, :1, :1] + RIDGE_LEAST) * np.eye(TERMS)
        field = np.linalg.solve(normal + ridge, right)
        current = reweigh(offset, basis, flow, weight, field, camera.scale_least)
    return np.asarray(field, np.float64)


@compiled
def normal_equations(offset: Ints, basis: Floats, flow: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """The two sides of the normal equations of the weighted fit of each frame.

    Parameters
    ----------
    offset, basis, flow, weight
        As in ``fit_fields``.

    Returns
    -------
    normal, right
        (F, 6, 6) and (F, 6, 2).
    """
    normal, right = np.zeros((len(offset) - 1, TERMS, TERMS)), np.zeros((len(offset) - 1, TERMS, 2))
    for t in range(len(offset) - 1):
        for k in range(offset[t], offset[t + 1]):
            for i in range(TERMS):
                scaled = weight[k] * basis[k, i]
                for j in range(i + 1):
                    normal[t, i, j] += scaled * basis[k, j]
                right[t, i, 0] += scaled * flow[k, 0]
                right[t, i, 1] += scaled * flow[k, 1]
        for i in range(TERMS):
            for j in range(i):
                normal[t, j, i] = normal[t, i, j]
    return normal, right


@compiled
def reweigh(offset: Ints, basis: Floats, flow: Floats, weight: Floats, field: Floats, least: float) -> Floats:
    """Weights of the next round: ``weight`` / (1 + (r / scale)²)², r the residual, scale its 1.48 median.

    Parameters
    ----------
    offset, basis, flow, weight
        As in ``fit_fields``.
    field
        (F, 6, 2) the fits of this round.
    least
        Smallest scale, px.

    Returns
    -------
    (superpixels)
    """
    residual, out = np.empty(len(weight)), np.empty(len(weight))
    for t in range(len(offset) - 1):
        for k in range(offset[t], offset[t + 1]):
            u, v = flow[k, 0], flow[k, 1]
            for i in range(TERMS):
                u -= basis[k, i] * field[t, i, 0]
                v -= basis[k, i] * field[t, i, 1]
            residual[k] = np.sqrt(u * u + v * v)
        a, b = offset[t], offset[t + 1]
        scale = max(MAD * _weighted_median(residual[a:b], weight[a:b]), least)
        for k in range(a, b):
            out[k] = weight[k] / (1 + (residual[k] / scale) ** 2) ** 2
    return out


@compiled
def _weighted_median(x: Floats, weight: Floats) -> float:
    """By a histogram, then one of the bin that holds it: no sorting, for this runs in each round for each frame."""
    low, width, below, half = 0.0, 0.0, 0.0, 0.0
    for k in range(len(x)):
        width = max(width, x[k])
        half += weight[k] / 2
    if width == 0.0:
        return 0.0
    for _ in range(2):
        count = np.zeros(BINS)
        for k in range(len(x)):
            place = (x[k] - low) / width * BINS
            if 0.0 <= place <= BINS:
                count[min(int(place), BINS - 1)] += weight[k]
        b = 0
        while b < BINS - 1 and below + count[b] < half:
            below += count[b]
            b += 1
        low, width = low + b * width / BINS, width / BINS
    return low + width
