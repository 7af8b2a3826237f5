"""The evidence for one object in words: affinity, residuals, margin, states, eigenvalues, and pair by pair."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.state import Hysteresis
from zsmoseg.proposals.embedded.objects import Selection
from zsmoseg.settings import Settings
from zsmoseg.workflows.result import Result
from zsmoseg.workflows.stages.embedded.objects import SuperpixelObjects
from zsmoseg.workflows.stages.front_end import Objects, Shot, local_ids, shots_of
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.groups import Groups
from zsmoseg.workflows.stages.motion.residuals import Residuals

T = TypeVar("T", Affinity, Groups)
SHOWN = 5
"""Eigenvalues that are told."""


def details(result: Result, number: int) -> list[str]:
    """What the stages keep about object ``number``, a line each."""
    shot = _shot_of(result, number)
    states = list(_with(result.groups, shot, number))
    margin = np.concatenate([block.margin[:, n] for block, n in states])
    moving = np.concatenate([block.moving[:, n] for block, n in states])
    frames = np.concatenate([np.arange(block.start, block.stop) for block, _ in states])
    groups = result.groups
    held = groups.excess[number] / groups.tolerance[number] if groups.group[number] else np.nan
    return [
        *_later_look(result, shot, number),
        _companions(result, shot, number),
        _residuals(result, shot, int(np.searchsorted(shot.objects, number))),
        _margin(margin, frames, float(held)),
        _states(moving, frames, margin, bool(groups.group[number]), _hysteresis(result)),
        _eigenvalues(states[0][0].eigenvalue[0]),
    ]


def _with(arrays: T, shot: Shot, number: int) -> Iterator[tuple[T, int]]:
    """The windows of a shot that show object ``number``, one in memory at a time, and its place in each."""
    for block in arrays.of(shot.start, shot.stop).blocks():
        place = int(np.searchsorted(block.object, number))
        if (block.has("moving") or block.has("affinity")) and block.object[place : place + 1] == number:
            yield block, place


def each_pair(result: Result, number: int) -> Iterator[str]:
    """What object ``number`` costs the static world, a line for every pair of frames that shows it."""
    shot = _shot_of(result, number)
    told = -1
    for found, local in _with(result.affinity, shot, number):
        columns = zip(*(x[:, local] for x in (found.excess, found.tolerance, found.weight)), strict=True)
        for pair, (excess, tolerance, weight) in enumerate(columns, start=found.start):
            if np.isfinite(excess) and pair > told:
                told, counts = pair, f"affinity {tolerance / (tolerance + excess):.2f}"
                counts = counts if weight > 0 else "counts for nothing"
                costs = f"costs {excess:.3f} px, tolerated {tolerance:.3f} px"
                yield f"frames {pair} and {pair + 1}: {costs}, {counts}"


def _shot_of(result: Result, number: int) -> Shot:
    return next(s for s in shots_of(Objects.read(result.artifact("objects"))) if number in s.objects)


def mean_residuals(result: Result, shot: Shot, local: int) -> NDArray[np.float64]:
    """(objects of the shot,) px: how much each one's model leaves on object ``local``; NaN: never seen together."""
    total, pairs = np.zeros(len(shot.objects)), np.zeros(len(shot.objects))
    for block in Residuals.read(result.artifact("residuals")).of(shot.start, shot.stop).blocks():
        keep, ids = local_ids(block.object, shot)
        for column in keep[ids == local]:
            left = block.residual[block.valid][:, keep, column]
            total[ids] += np.where(np.isfinite(left), left, 0.0).sum(0)
            pairs[ids] += np.isfinite(left).sum(0)
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


def _margin(margin: NDArray[np.float32], frames: NDArray[np.int64], held: float) -> str:
    """``held``: the odds of a mover over the shot; below 1 its margin is over them."""
    known = np.flatnonzero(np.isfinite(margin))
    if not len(known):
        return "margin: unknown, there is no pair of frames that shows it against the background"
    low, high = known[margin[known].argmin()], known[margin[known].argmax()]
    over = f" over its own in the whole shot ({held:.2f}), as these are below 1" if held < 1 else ""
    return (
        f"margin, ln of the odds against the static world{over}: median {np.median(margin[known]):+.2f}, "
        f"from {margin[low]:+.2f} at frame {frames[low]} to {margin[high]:+.2f} at frame {frames[high]}"
    )


def _hysteresis(result: Result) -> Hysteresis:
    """The settings by which movers rest."""
    described = result.artifact("groups").description or {}
    return Settings.model_validate(described["settings"]).groups.parameters(Hysteresis)


def _states(
    moving: NDArray[np.bool_],
    frames: NDArray[np.int64],
    margin: NDArray[np.float32],
    mover: bool,
    rule: Hysteresis,
) -> str:
    if not mover:
        return "moving at no frame: it is static"
    runs = [f"{a} to {b}" if a < b else str(a) for a, b in _runs(frames[moving])]
    told = f"moving at frames {', '.join(runs)}" if runs else "moving at no frame"
    if not np.isfinite(margin).any():
        return f"{told}: wherever it is seen, as its margin is unknown"
    low, high = np.log([rule.state_low, rule.state_high])
    return (
        f"{told}: at first by the sign of its margin, then from above {high:+.2f} on until below {low:+.2f}"
    )


def _runs(frames: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """First and last frame of each run of frames that follow each other."""
    for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
        if len(run):
            yield int(run[0]), int(run[-1])


def _later_look(result: Result, shot: Shot, number: int) -> Iterator[str]:
    """Of an object of the embedded front end that the first look did not find."""
    if "segments" not in result.keys:
        return
    for block in SuperpixelObjects.read(result.artifact("objects")).of(shot.start, shot.stop).blocks():
        if block.has("look") and (mine := block.object_of == number).any():
            look, sure = int(block.look[mine].max()), float(block.sure[mine].max())
            if look > 1:
                yield (
                    f"found by look {look}, among what those before had left, where it is the fastest: mean score {sure:.2f} "
                    f"over its life, {Selection.sure:.2f} are asked for"
                )
            return


def _companions(result: Result, shot: Shot, number: int) -> str:
    """Of the first window that shows the object."""
    found, local = next(_with(result.affinity, shot, number))
    similar = np.where(np.isfinite(found.affinity[local]), found.affinity[local], -1.0)
    others = [n for n in np.argsort(-similar, kind="stable") if n not in (local, 0) and similar[n] >= 0]
    world = (
        f"affinity with the static world {similar[0]:.2f}"
        if similar[0] >= 0
        else "no affinity with the world"
    )
    if not others:
        return f"{world}; it is never seen together with another object"
    told = ", ".join(f"{similar[n]:.2f} with object {found.object[n]}" for n in others[:SHOWN])
    return f"{world}; {told}; from 0.50 on one motion explains both"


def _eigenvalues(values: NDArray[np.float64]) -> str:
    return (
        f"eigenvalues of the normalised affinity of its shot: {', '.join(f'{v:.2f}' for v in values[:SHOWN])}"
    )
