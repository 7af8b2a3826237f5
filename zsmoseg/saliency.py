"""Which superpixels move by themselves, over the frames of one shot.

What sets them apart: motion that is not the camera's and is closed off from the border of the frame, spread over
like neighbours in space and time, cut where motion and colour both change, and confirmed by colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg import kernels, settings
from zsmoseg.appearance import vote
from zsmoseg.layers import layers
from zsmoseg.spacetime import (
    CHANGE,
    ERROR,
    Floats,
    Ints,
    Window,
    diffuse,
    from_border,
    similarity,
    window,
    windowed,
)
from zsmoseg.tables import ChunkTables
from zsmoseg.tracking import Ids, Tracker, pieces

LENGTH = 160
"""Frames that are decided on at once."""
MARGIN = 30
"""Frames beyond the window of the threshold that are looked at on both sides of them."""


def find_objects(
    load: Callable[[int, int], ChunkTables],
    shot: tuple[int, int],
    shape: tuple[int, int],
    s: settings.Objects,
) -> Iterator[tuple[NDArray[np.float32], Ids, float]]:
    """The objects of a shot, frame by frame.

    The shot is worked on in windows of ``LENGTH`` frames, counted from its start, so memory does not grow with it.

    Parameters
    ----------
    load
        ``load(a, b)`` gives the tables of the frames a to b - 1 and of the pairs inside them.
    shot
        First frame, and the one after the last; no cut inside.
    shape
        Height and width of the working grid, px.
    s
        The section ``objects`` of the settings.

    Yields
    ------
    value
        (superpixels) log(saliency / threshold) over ``softness``: above 0 is foreground.
    ids
        (superpixels) object, 1 upwards and stable over the shot; 0 where there is none.
    score
        0: nothing moves by itself, to 1: something surely does.
    """
    start, stop = shot
    tracker = Tracker()
    margin = s.window + MARGIN
    for first in range(start, stop, LENGTH):
        last = min(first + LENGTH, stop)
        low, high = max(first - margin, start), min(last + margin, stop)
        w = window(load(low, high), low - start, shape)
        verdict = judge(w, s)
        layer = _layers(w, verdict, s)
        known, named = w.offset[[first - low, last - low]]
        ids = tracker.name(layer[:named], w.size[:named], int(known))
        for t in range(first - low, last - low):
            here = w.of(t)
            value = verdict.value[here].astype(np.float32)
            yield value, ids[here.start - known : here.stop - known], verdict.score[t]


def _layers(w: Window, verdict: Verdict, s: settings.Objects) -> Ints:
    """(nodes) layer, or ``NONE``."""
    foreground = (verdict.value > 0) & (verdict.score >= s.score)[w.frame]
    smallest = s.smallest * w.shape[0] * w.shape[1]
    return pieces(foreground, layers(w, foreground, s), w.size, w.edge, smallest)


@dataclass(frozen=True)
class Verdict:
    """What is found out about a window."""

    value: Floats
    """(nodes) log(saliency / threshold) / softness."""
    score: Floats
    """(F) 0 to 1."""


def judge(w: Window, s: settings.Objects) -> Verdict:
    """Value of every node and score of every frame of a window.

    The camera's motion is fitted twice: to everything, then to what has not turned out to be foreground. So a
    thing that fills most of a frame does not pass for the background where the frames around know it.
    """
    weight = similarity(w, s.link_colour, s.link_time)
    texture = (w.detail[:, 1] + w.detail[:, 3]) / 2
    trust = np.maximum(texture / (texture + s.trust_texture**2), s.trust_least)
    trust = np.where(w.known[w.frame], trust, 1e-3)
    parted = 1 - np.exp(-from_border(w, w.edge_colour, np.zeros(len(w.frame))) / s.border_colour)
    contrast = boundary_contrast(w, s)
    moving = motion(w, camera_residual(w, own_motion(w, w.size, s)), s) * parted
    x = diffuse(weight, moving, s.spread, trust, 3e-2)
    soft = _soft(w, x, thresholds(w, x, contrast, s), s)
    own = own_motion(w, w.size * (1 - soft), s)
    residual = camera_residual(w, own)
    moving = motion(w, residual, s) * parted
    both = np.stack([moving, moving * cleanness(w, residual, s)], 1)
    x, clean = diffuse(weight, both, s.spread, trust).T
    x = x * persistence(w, x, clean, s)
    threshold = thresholds(w, x, contrast, s)
    score = np.clip((threshold - s.threshold) / (s.threshold_sure - s.threshold), 0, 1)
    soft = _soft(w, x, threshold, s)
    seen = soft * visibility(w, own, residual, s)
    x = diffuse(weight, (seen + vote(w, soft, s)) / 2, s.spread)
    return Verdict(_logit(w, x, thresholds(w, x, contrast, s), s), score)


def _logit(w: Window, x: Floats, threshold: Floats, s: settings.Objects) -> Floats:
    return np.asarray(np.log(np.maximum(x, 1e-4) / threshold[w.frame]) / s.softness)


def _soft(w: Window, x: Floats, threshold: Floats, s: settings.Objects) -> Floats:
    return np.asarray(1 / (1 + np.exp(-_logit(w, x, threshold, s))))


def own_motion(w: Window, weight: Floats, s: settings.Objects) -> tuple[Floats, Floats]:
    """(nodes, 2) each: what the flow forth, and back, is beyond the camera's motion, px.

    The camera's motion is a quadratic field, fitted in each frame and direction to the nodes with a ``weight``
    (nodes) by iteratively re-weighted least squares: weights over (1 + (r / scale)^2)^2, scale = 1.48 median of
    the residuals r and at least 0.1 px.
    """
    height, width = w.shape
    y, x = ((w.place - [height / 2, width / 2]) / (width / 2)).T
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], 1)

    def residual(flow: Floats) -> Floats:
        field = fit_fields(w.offset, basis, flow, weight, s.camera_rounds)
        return np.asarray(flow[:, :2] - np.einsum("nk,nkc->nc", basis, field[w.frame]), np.float64)

    return residual(w.forth), residual(w.back)


def fit_fields(
    offset: NDArray[np.int64], basis: Floats, flow: Floats, weight: Floats, rounds: int, least: float = 0.1
) -> Floats:
    """Robust fits (frames, 6, 2) of a flow (nodes, 2) by a basis (nodes, 6), frame by frame; ``least`` in px."""
    current = weight = np.ascontiguousarray(weight)
    for _ in range(rounds):
        normal, right = kernels.normal_equations(offset, basis, flow, current)
        field = np.linalg.solve(normal + 1e-5 * (normal[:, :1, :1] + 0.1) * np.eye(6), right)
        current = kernels.reweigh(offset, basis, flow, weight, field, least)
    return np.asarray(field, np.float64)


def camera_residual(w: Window, own: tuple[Floats, Floats]) -> Floats:
    """(nodes) length of the own motion, px: mean of both directions, each over 1 + error^2."""
    forth, back = (1 / (1 + flow[:, ERROR] ** 2) for flow in (w.forth, w.back))
    return np.asarray((forth * np.hypot(*own[0].T) + back * np.hypot(*own[1].T)) / (forth + back), np.float64)


def motion(w: Window, residual: Floats, s: settings.Objects) -> Floats:
    """(nodes) 0 to 1: moves unlike the camera, and is parted from the border of the frame by motion."""
    forth, back = w.edge_flow
    closed = from_border(w, np.maximum((forth + back) / 2 - s.flow_noise, 0), s.border_entry * residual)
    return np.asarray(np.sqrt(relative(w, residual, s) * relative(w, closed, s)), np.float64)


def relative(w: Window, x: Floats, s: settings.Objects) -> Floats:
    """(nodes) ``x`` over what is ``full`` for its frame, at most 1."""
    return np.minimum(x / full(w, x, s)[w.frame], 1)


def full(w: Window, x: Floats, s: settings.Objects) -> Floats:
    """(F) the ``top`` quantile of ``x``: median over the frames up to ``top_window`` away, at least ``top_least``."""
    high = np.array([np.quantile(x[w.of(t)], s.top) if w.known[t] else np.nan for t in range(w.frames)])
    around = (high[max(0, t - s.top_window) : t + s.top_window + 1] for t in range(w.frames))
    middle = np.array([np.median(part[~np.isnan(part)]) if (part > 0).any() else 0 for part in around])
    return np.asarray(np.maximum(middle, s.top_least), np.float64)


def visibility(w: Window, own: tuple[Floats, Floats], residual: Floats, s: settings.Objects) -> Floats:
    """(nodes) 0 to 1: whether its own motion shows in the picture.

    Flow is carried on from things into what has no detail of its own beside them (sky, shadow, water). There the
    camera's motion explains the picture as well as the flow does. What the own motion d would change is
    d' G d, G the mean outer product of the slope of the detail (Lucas, Kanade 1981), and at most twice the detail;
    it is compared with what the flow leaves unexplained. This counts as far as a node has the detail to show
    the motion of the things in its frame.
    """
    detail, (xx, xy, yy) = w.detail[:, 0], w.detail[:, 1:].T
    changed = sum(
        np.minimum(xx * d[:, 0] ** 2 + 2 * xy * d[:, 0] * d[:, 1] + yy * d[:, 1] ** 2, 2 * detail) / 2
        for d in own
    )
    left = (w.forth[:, CHANGE] + w.back[:, CHANGE]) / 2
    excess = np.maximum((changed + 1) / (left + 1) - 1, 0)
    would = np.minimum((xx + yy) / 2 * full(w, residual, s)[w.frame] ** 2, 2 * detail)
    return np.asarray(1 - would / (would + s.show_detail) / (1 + excess / s.show_excess))


def cleanness(w: Window, residual: Floats, s: settings.Objects) -> Floats:
    """(nodes) 0 to 1: how well the flow closes forth and back, for the motion that there is."""
    error = np.minimum(w.forth[:, ERROR], w.back[:, ERROR]) / (residual + s.clean_pad)
    return np.asarray(1 / (1 + (error / s.clean_error) ** 2))


def persistence(w: Window, x: Floats, clean: Floats, s: settings.Objects) -> Floats:
    """(nodes) weight 0 to 1 of the saliency ``x``, of which ``clean`` comes from flow that closes.

    Spray, waves and smoke form and dissolve, so their flow does not close; nor does that of thin and fast things
    and of the rims of all things. So this counts only where, over the frames around, something that moves is
    clean and most of what seems to move is not.
    """
    share = np.clip(clean / np.maximum(x, 1e-6), 0, 1)
    bins = s.threshold_bins
    key = w.frame * bins + np.minimum((share * bins).astype(np.int64), bins - 1)
    count = np.bincount(key, w.size * x**2, w.frames * bins).reshape(w.frames, bins).astype(np.float64)
    count = np.cumsum(windowed(count, s.window), 1)
    total = count[:, -1:]
    best = ((count < s.clean_top * total).sum(1) + 0.5) / bins
    half = np.minimum((best * s.clean_half * bins).astype(np.int64), bins - 1)
    unclean = count[np.arange(w.frames), half] / np.maximum(total[:, 0], 1e-9)
    demand = _ramp(best, s.clean_from, s.clean_full) * _ramp(unclean, s.unclean_from, s.unclean_full)
    return np.asarray(np.minimum(share / best[w.frame], 1) ** (s.clean_power * demand[w.frame]))


def _ramp(x: Floats, low: float, high: float) -> Floats:
    return np.asarray(np.clip((x - low) / max(high - low, 1e-9), 0, 1))


def boundary_contrast(w: Window, s: settings.Objects) -> Floats:
    """(edges) 0 to 1: how much motion and colour both change."""
    colour = 1 - np.exp(-w.edge_colour / s.contrast_colour)
    return np.asarray(colour * (1 - np.exp(-np.minimum(*w.edge_flow) / s.contrast_flow)))


def thresholds(w: Window, x: Floats, contrast: Floats, s: settings.Objects) -> Floats:
    """(F) the threshold of ``x`` (nodes) that parts two classes best, over the frames up to ``window`` away.

    Of ``threshold_bins`` levels the one with the largest product of the share of the variance that lies between
    the classes (Otsu 1979) and of the mean ``contrast`` (edges) along the boundary between them.
    """
    bins = s.threshold_bins
    top = max(np.quantile(x, 0.99), 1e-6)
    level = np.clip((x / top * bins).astype(np.int64), 0, bins - 1)
    on = w.known.astype(np.float64)[w.frame]

    def table(nodes: NDArray[np.int64], key: NDArray[np.int64], count: Floats) -> Floats:
        summed = np.bincount(w.frame[nodes] * bins + key, count, w.frames * bins)
        return np.asarray(summed, np.float64).reshape(w.frames, bins)

    i, j = w.edge.T
    low, high = np.minimum(level[i], level[j]), np.maximum(level[i], level[j])

    def along(count: Floats) -> Floats:
        count = count * on[i]
        return windowed(np.cumsum(table(i, low, count) - table(i, high, count), 1), s.window)

    cut = along(w.boundary * contrast) / np.maximum(along(w.boundary), 1e-9)
    count = windowed(table(np.arange(len(x)), level, w.size * on), s.window)
    centre = (np.arange(bins) + 0.5) / bins
    below, moment = np.cumsum(count, 1), np.cumsum(count * centre, 1)
    total = np.maximum(below[:, -1:], 1e-9)
    mean = moment[:, -1:] / total
    variance = np.maximum((count * centre**2).sum(1, keepdims=True) / total - mean**2, 1e-12)
    between = (mean * below - moment) ** 2 / np.maximum(below * (total - below), 1e-9) / variance
    allowed = (np.arange(bins) / bins >= s.threshold_low) & (total - below > 0.002 * total)
    best = np.where(allowed, between * cut, -1).argmax(1)
    return np.asarray(np.maximum((best + 1) / bins * top, s.threshold), np.float64)
