"""Which objects move: their evidence against that of pieces of the same background."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.grouping.evidence import Shot, ShotEvidence, shot_evidence
from zsmoseg.motion.models import Floats, Model

TINY = 1e-6
"""px of own residual that a ratio is taken over at least."""

Count = Literal["auto"] | int
"""Number of groups, the static one included, or ``auto``."""


@dataclass(frozen=True)
class Thresholds:
    """Numbers of the calibrated rule; excess is a root mean square in px of the working grid."""

    count: Count
    """Number of groups."""
    floor: float
    """px, excess below it is never motion: precision of the flow."""
    quantile: float
    """Quantile of the cells' excess that is the yardstick."""
    significant: float
    """Part of the largest object from which on the strongest is sought."""
    exist: float
    """Largest cells that the strongest must exceed for anything to move."""
    clear: float
    """px, excess of proposals that are never all dropped ..."""
    clear_cells: float
    """... if they also reach this many largest cells."""
    top_fraction: float
    """Part of the strongest below which an object does not move ..."""
    small: float
    """Part of the strongest's pixels below which an object is small, as leaks are, and ..."""
    small_fraction: float
    """... does not move below this part of the strongest ..."""
    certain: float
    """... unless its excess is this many yardsticks and above the largest cell."""
    coherent: float
    """Excess over what an object's own motion leaves below which it is no evidence ..."""
    coherent_part: float
    """... but no more than this part of what the strongest has."""
    below_strongest: float
    """Part of the strongest below which the threshold stays."""
    rounds: int
    """Passes; from the second on static objects belong to the world."""
    noise_area: float
    """px^2 over which the error of the flow is correlated."""


@dataclass(frozen=True)
class Decision:
    """Which of N objects move, and why."""

    moving: NDArray[np.bool_]
    """(N,)."""
    score: Floats
    """(N,) px, mean rms excess over the static world."""
    yardstick: float
    """px, what most cells of the background stay below."""
    largest: float
    """px, the largest cell."""
    threshold: Floats
    """(N,) px; infinite where nothing moves."""
    evidence: ShotEvidence
    """Of the last pass."""


def decide(
    shot: Shot, area: Floats, model: Model, rule: Thresholds, visible: NDArray[np.bool_] | None = None
) -> Decision:
    """The calibrated rule.

    0. Evidence is what an object costs the static world beyond its own motion. Where that is no more than what its own
       motion leaves of it, as in water, it is none: at least ``coherent`` times as much, or ``coherent_part`` of what
       the strongest object has, whichever is less.
    1. The yardstick nu is the ``quantile`` of the cells' evidence, at least ``floor``; tau the strongest among the
       objects with ``significant`` of the largest object's pixels or more.
    2. Nothing moves if tau is below ``exist`` largest cells, unless the proposals are clear: above ``clear`` px and
       ``clear_cells`` largest cells.
    3. Moving is what exceeds min(max(sqrt(nu tau), part tau), max(certain nu, largest cell), below_strongest tau). The
       part is ``top_fraction``; for what has less than ``small`` of the strongest's pixels, as its leaks and shadows
       have, it is ``small_fraction``.
    4. What is static joins the world; once more from 1, ``rounds`` times in all.

    Parameters
    ----------
    shot : the Grams of its pairs.
    area : (N,) pixels of every object over the shot, the background first.
    visible : (N,) false where the image shows no motion whatever the flow says: no evidence counts there.
    """
    count = len(area)
    static = np.arange(count) == 0
    significant = area >= rule.significant * area[1:].max(initial=0.0)
    significant[0] = False
    nothing, never = np.zeros(count), np.full(count, np.inf)
    none = ShotEvidence([], nothing, nothing, np.zeros(0))
    decision = Decision(np.zeros(count, np.bool_), nothing, 0.0, 0.0, never, none)
    for _ in range(rule.rounds):
        found = shot_evidence(shot, count, model, static, rule.noise_area)
        counts = coherent(found, significant, rule)
        if visible is not None:
            counts &= visible
        found = replace(found, score=np.where(counts, found.score, 0.0))
        decision = _judged(found, area, significant, rule)
        if np.array_equal(~decision.moving, static):
            break
        static = ~decision.moving
    return decision


def _judged(found: ShotEvidence, area: Floats, significant: NDArray[np.bool_], rule: Thresholds) -> Decision:
    """Steps 1 to 3 on the evidence of one pass."""
    largest = max(float(found.cells.max(initial=0.0)), rule.floor)
    nu = max(float(np.quantile(found.cells, rule.quantile)) if found.cells.size else 0.0, rule.floor)
    tau = float(found.score[significant].max(initial=0.0))
    strongest = int(np.where(significant, found.score, -1.0).argmax())
    part = np.where(area < rule.small * area[strongest], rule.small_fraction, rule.top_fraction)
    threshold = threshold_of(nu, largest, tau, part, rule)
    return Decision(found.score > threshold, found.score, nu, largest, threshold, found)


def coherent(found: ShotEvidence, significant: NDArray[np.bool_], rule: Thresholds) -> NDArray[np.bool_]:
    """(N,) whether the evidence of an object is that of a motion: more than its own motion leaves of its flow."""
    ratio = found.score / np.maximum(found.own, TINY)
    strongest = int(np.where(significant, found.score, -1.0).argmax())
    return np.asarray(ratio >= min(rule.coherent, rule.coherent_part * float(ratio[strongest])))


def threshold_of(nu: float, largest: float, tau: float, part: Floats, rule: Thresholds) -> Floats:
    """The thresholds (N,) in px for yardstick, largest cell and strongest object; infinite where nothing moves.

    Who asks for two groups or more says that something moves.

    Parameters
    ----------
    part : (N,) of the strongest's evidence that an object needs.
    """
    clear = tau >= rule.clear and tau >= rule.clear_cells * largest
    if rule.count in ("auto", 1) and tau < rule.exist * largest and not clear:
        return np.full(part.shape, np.inf)
    weak = np.maximum(np.sqrt(nu * tau), part * tau)
    return np.minimum(weak, min(max(rule.certain * nu, largest), rule.below_strongest * tau))
