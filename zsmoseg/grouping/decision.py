"""Which objects move: their evidence against that of pieces of the same background."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.grouping.evidence import Shot, ShotEvidence, shot_evidence
from zsmoseg.motion.models import Floats, Model


@dataclass(frozen=True)
class Decision:
    """Which of N objects move, and why."""

    moving: NDArray[np.bool_]
    score: Floats
    """(N,) px, mean rms excess over the static world."""
    yardstick: float
    """px, what most cells of the background stay below."""
    largest: float
    """px, the largest cell."""
    threshold: Floats
    """(N,) px; infinite where nothing moves."""
    evidence: ShotEvidence

    @property
    def confidence(self) -> float:
        """Strongest object over largest cell; below 1 nothing surely moves."""
        return float(self.score.max(initial=0.0) / self.largest) if self.largest else 0.0


def decide(
    shot: Shot, area: Floats, model: Model, s: settings.Groups, visible: NDArray[np.bool_] | None = None
) -> Decision:
    """The calibrated rule.

    0. Evidence is what an object costs the static world beyond its own motion. Where that is no more than what its own
       motion leaves of it, as in water, it is none: at least ``coherent`` times as much, or ``coherent_part`` of what
       the strongest object has, whichever is less.
    1. The yardstick nu is the ``quantile`` of the cells' evidence, at least ``floor``; tau the strongest among the
       objects with ``significant`` of the largest object's pixels or more.
    2. Nothing moves if tau is below ``exist`` largest cells, unless the proposals are clear: above ``clear`` px and
       ``clear_cells`` largest cells.
    3. Moving is what exceeds min(max(sqrt(nu tau), part tau), max(certain nu, largest cell), keep tau). The part is
       ``top_fraction``; for what has less than ``small`` of the strongest's pixels, as its leaks and shadows have, it
       is ``small_fraction``.
    4. What is static joins the world; once more from 1, ``rounds`` times in all.

    Parameters
    ----------
    shot : the Grams of its pairs.
    area : (N,) pixels of every object over the shot, the background first.
    visible : (N,) false where the image shows no motion whatever the flow says: no evidence counts there.
    """
    count = len(area)
    static = np.arange(count) == 0
    significant = area >= s.significant * area[1:].max(initial=0.0)
    significant[0] = False
    moving = np.zeros(count, np.bool_)
    nothing, never = np.zeros(count), np.full(count, np.inf)
    decision = Decision(moving, nothing, 0.0, 0.0, never, ShotEvidence([], nothing, nothing, np.zeros(0)))
    for _ in range(s.rounds):
        found = shot_evidence(shot, count, model, static, s.noise_area)
        counts = coherent(found, significant, s)
        if visible is not None:
            counts &= visible
        found = replace(found, score=np.where(counts, found.score, 0.0))
        largest = max(float(found.cells.max(initial=0.0)), s.floor)
        nu = max(float(np.quantile(found.cells, s.quantile)) if found.cells.size else 0.0, s.floor)
        tau = float(found.score[significant].max(initial=0.0))
        strongest = int(np.where(significant, found.score, -1.0).argmax())
        part = np.where(area < s.small * area[strongest], s.small_fraction, s.top_fraction)
        threshold = threshold_of(nu, largest, tau, part, s)
        moving = found.score > threshold
        decision = Decision(moving, found.score, nu, largest, threshold, found)
        if np.array_equal(~moving, static):
            break
        static = ~moving
    return decision


def coherent(found: ShotEvidence, significant: NDArray[np.bool_], s: settings.Groups) -> NDArray[np.bool_]:
    """(N,) whether the evidence of an object is that of a motion: more than its own motion leaves of its flow."""
    ratio = found.score / np.maximum(found.own, 1e-6)
    strongest = int(np.where(significant, found.score, -1.0).argmax())
    return np.asarray(ratio >= min(s.coherent, s.coherent_part * float(ratio[strongest])))


def threshold_of(nu: float, largest: float, tau: float, part: Floats, s: settings.Groups) -> Floats:
    """The thresholds (N,) in px for yardstick, largest cell and strongest object; infinite where nothing moves.

    Who asks for two groups or more says that something moves.

    Parameters
    ----------
    part : (N,) of the strongest's evidence that an object needs.
    """
    clear = tau >= s.clear and tau >= s.clear_cells * largest
    if s.count in ("auto", 1) and tau < s.exist * largest and not clear:
        return np.full(part.shape, np.inf)
    weak = np.maximum(np.sqrt(nu * tau), part * tau)
    return np.minimum(weak, min(max(s.certain * nu, largest), s.keep * tau))
