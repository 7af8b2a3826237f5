"""The evidence for one object in words: residuals, margin, states, eigenvalues."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from zsmoseg.workflows.result import Result
from zsmoseg.workflows.stages.front_end import Objects, Shot, shots_of
from zsmoseg.workflows.stages.motion.affinity import Affinity, each_residual
from zsmoseg.workflows.stages.motion.residuals import Residuals

SHOWN = 5
"""Eigenvalues that are told."""


def details(result: Result, number: int) -> list[str]:
    """What the stages keep about object ``number``, a line each."""
    shot = next(s for s in shots_of(Objects.read(result.artifact("objects"))) if number in s.objects)
    (state,) = result.groups.of(shot.start, shot.stop).blocks()
    local = int(np.searchsorted(shot.objects, number))
    return [
        _residuals(result, shot, local),
        _margin(state.margin[:, local], shot.start),
        _states(state.moving[:, local], shot.start),
        _companions(result, shot, local),
        _background(state.cell_excess[0], state.eigenvalue[0]),
    ]


def mean_residuals(result: Result, shot: Shot, local: int) -> NDArray[np.float64]:
    """(objects of the shot,) px: how much each one's model leaves on object ``local``; NaN: never seen together."""
    total, pairs = np.zeros(len(shot.objects)), np.zeros(len(shot.objects))
    for ids, residual, _ in each_residual(Residuals.read(result.artifact("residuals")), shot):
        for column in np.flatnonzero(ids == local):
            seen = np.isfinite(residual[:, column])
            total[ids[seen]] += residual[seen, column]
            pairs[ids[seen]] += 1
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(total / np.where(pairs > 0, pairs, np.nan)))


def _residuals(result: Result, shot: Shot, local: int) -> str:
    left = mean_residuals(result, shot, local)
    if not np.isfinite(left[local]):
        return "residuals: it has too few pixels in every pair of frames to fit a motion to it"
    others = np.where(np.arange(len(left)) == local, np.inf, np.where(np.isfinite(left), left, np.inf))
    others[0] = np.inf
    best = int(others.argmin())
    nearest = (
        f"; of the other objects' motions that of object {shot.objects[best]} fits it best ({others[best]:.3f} px)"
        if np.isfinite(others[best])
        else ""
    )
    return (
        f"residuals, root mean square: its own motion leaves {left[local]:.3f} px of its flow, the background's "
        f"motion {left[0]:.3f} px{nearest}"
    )


def _margin(margin: NDArray[np.float32], start: int) -> str:
    known = np.flatnonzero(np.isfinite(margin))
    if not len(known):
        return "margin: unknown, there is no pair of frames that shows it against the background"
    low, high = known[margin[known].argmin()], known[margin[known].argmax()]
    return (
        f"margin, ln(excess / threshold): median {np.median(margin[known]):+.2f}, from {margin[low]:+.2f} at frame "
        f"{start + low} to {margin[high]:+.2f} at frame {start + high}"
    )


def _states(moving: NDArray[np.bool_], start: int) -> str:
    runs = [f"{a} to {b - 1}" for a, b in _runs(moving, start)]
    return f"moving at frames {', '.join(runs)}" if runs else "moving at no frame"


def _runs(moving: NDArray[np.bool_], start: int) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(np.int8), [0]])))
    yield from ((int(a) + start, int(b) + start) for a, b in list(pairwise(edges))[::2])


def _companions(result: Result, shot: Shot, local: int) -> str:
    (found,) = Affinity.read(result.artifact("affinity")).of(shot.start, shot.stop).blocks()
    together, similar = found.together[:, local].sum(0), found.affinity[local]
    others = [n for n in np.argsort(-similar, kind="stable") if n != local and together[n] > 0][:SHOWN]
    if not others:
        return "affinity: it is never seen together with another object"
    told = ", ".join(
        f"{similar[n]:.2f} with {f'object {shot.objects[n]}' if n else 'the background'}" for n in others
    )
    return f"affinity: {told}"


def _background(cells: NDArray[np.float64], eigenvalues: NDArray[np.float64]) -> str:
    pieces = (
        f"pieces of the background cost {np.median(cells):.3f} px, the largest {cells.max():.3f} px; "
        if len(cells)
        else ""
    )
    told = ", ".join(f"{v:.2f}" for v in eigenvalues[:SHOWN])
    return f"{pieces}eigenvalues of the normalised affinity of its shot: {told}"
