"""Which superpixels move by themselves, over a window of frames: the steps of ``docs/embedded.md`` from 3 to 10.

What sets them apart: motion that is not the camera's and is closed off from the border of the frame, spread over
like neighbours in space and time, cut where motion and colour both change, and confirmed by colour. All of this is
relative to the fastest of the frame; so it is looked at again without them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from zsmoseg.proposals.embedded.aliases import Bools, Floats
from zsmoseg.proposals.embedded.bilateral_grid import BilateralGrid, smooth
from zsmoseg.proposals.embedded.camera import Camera, own_motion, speed
from zsmoseg.proposals.embedded.diffusion import Diffusion, diffuse, similarity
from zsmoseg.proposals.embedded.enclosure import Enclosure, enclosed_by_colour, enclosed_by_motion
from zsmoseg.proposals.embedded.full_motion import FullMotion, against_full_motion, full
from zsmoseg.proposals.embedded.graph import Graph
from zsmoseg.proposals.embedded.persistence import Cleanness, Persistence, cleanness, persistence
from zsmoseg.proposals.embedded.threshold import (
    Contrast,
    Threshold,
    boundary_contrast,
    log_odds,
    probability,
    score,
    thresholds,
)
from zsmoseg.proposals.embedded.visibility import Trust, Visibility, trust, visibility

FIRST_TOLERANCE = 3e-2
"""Of the first diffusion, coarser than the others: it only says what the camera is fitted to."""


@dataclass(frozen=True)
class Saliency:
    """Parameters of all steps, numbered as in ``docs/embedded.md``."""

    camera: Camera
    """Fit of the camera's motion (step 3)."""
    full_motion: FullMotion
    """Scale of motion (4, 8)."""
    enclosure: Enclosure
    """Geodesic distance from the border (4)."""
    diffusion: Diffusion
    """Ties of like colour (5, 9)."""
    trust: Trust
    """Say of what has little texture (5)."""
    contrast: Contrast
    """Contrast of boundaries (7, 9)."""
    threshold: Threshold
    """Threshold and score (7, 9)."""
    cleanness: Cleanness
    """How well flow closes (6)."""
    persistence: Persistence
    """Where that is demanded (6)."""
    visibility: Visibility
    """What motion must show (8)."""
    bilateral_grid: BilateralGrid
    """Likeness in colour, place and time (9)."""


@dataclass(frozen=True)
class Look:
    """What one look at a window finds."""

    value: Floats
    """(superpixels) log-odds of being foreground: log(saliency / threshold) / softness."""
    score: Floats
    """(F) 0: nothing moves by itself, to 1: something surely does."""


@dataclass(frozen=True)
class Ties:
    """What holds superpixels together and sets them apart, however they move."""

    weight: scipy.sparse.csr_array
    """(superpixels, superpixels) of the diffusion."""
    trust: Floats
    """(superpixels) in motion."""
    enclosed: Floats
    """(superpixels) by colour."""
    contrast: Floats
    """(edges)."""


@dataclass(frozen=True)
class OwnMotion:
    """How superpixels move by themselves."""

    speed: Floats
    """(superpixels) px."""
    enclosed: Floats
    """(superpixels) px, change of the flow on every path from the border of the frame."""

    @classmethod
    def of(cls, graph: Graph, own_speed: Floats, enclosure: Enclosure) -> OwnMotion:
        """That of superpixels of the own speed (superpixels), px."""
        return cls(own_speed, enclosed_by_motion(graph, own_speed, enclosure))


@dataclass(frozen=True)
class Seen:
    """What the first look leaves for others."""

    ties: Ties
    motion: OwnMotion
    lasting: Floats
    """(superpixels) 0 to 1: persistence."""


def first_look(graph: Graph, parameters: Saliency) -> tuple[Look, Seen]:
    """Value of every superpixel and score of every frame of a window.

    The camera's motion is fitted twice: to everything, then to what has not turned out to be foreground. So an
    object that fills most of a frame does not pass for the background where the frames around know it.
    """
    p, everything = parameters, np.ones(len(graph.frame), np.bool_)
    ties = Ties(
        weight=similarity(graph, p.diffusion),
        trust=trust(graph, p.trust),
        enclosed=enclosed_by_colour(graph, p.enclosure),
        contrast=boundary_contrast(graph, p.contrast),
    )
    guess = first_guess(graph, ties, p)
    # 3. own motion beyond the camera's
    own = own_motion(graph, graph.size * (1 - guess), p.camera)
    motion = OwnMotion.of(graph, speed(graph, own), p.enclosure)
    # 4. closed off by motion and by colour
    closed = closed_off(graph, ties, motion, everything, p)
    # 5. diffusion: of all of it, and of what comes from flow that closes
    both = np.stack([closed, closed * cleanness(graph, motion.speed, p.cleanness)], 1)
    spread, clean = diffuse(ties.weight, both, p.diffusion.spread, p.diffusion.tolerance, ties.trust).T
    # 6. persistence
    window, bins = p.threshold.window, p.threshold.threshold_bins
    lasting = persistence(graph, spread, clean, p.persistence, window, bins)
    # 7. threshold, and the score of the frames
    threshold = thresholds(graph, spread * lasting, ties.contrast, everything, p.threshold)
    foreground = probability(graph, spread * lasting, threshold, p.threshold)
    # 8. visibility
    top = full(graph, motion.speed, everything, p.full_motion)
    seen = foreground * visibility(graph, own, top, p.visibility)
    # 9. appearance, then diffusion and threshold once more
    confirmed = (seen + smooth(graph, foreground, p.bilateral_grid)) / 2
    saliency = diffuse(ties.weight, confirmed, p.diffusion.spread, p.diffusion.tolerance)
    last_threshold = thresholds(graph, saliency, ties.contrast, everything, p.threshold)
    value = log_odds(graph, saliency, last_threshold, p.threshold)
    return Look(value, score(threshold, p.threshold)), Seen(ties, motion, lasting)


def first_guess(graph: Graph, ties: Ties, parameters: Saliency) -> Floats:
    """(superpixels) 0 to 1: foreground by steps 3 to 7 but for persistence, the camera fitted to everything."""
    p, everything = parameters, np.ones(len(graph.frame), np.bool_)
    own_speed = speed(graph, own_motion(graph, graph.size, p.camera))
    closed = closed_off(graph, ties, OwnMotion.of(graph, own_speed, p.enclosure), everything, p)
    spread = diffuse(ties.weight, closed, p.diffusion.spread, FIRST_TOLERANCE, ties.trust)
    threshold = thresholds(graph, spread, ties.contrast, everything, p.threshold)
    return probability(graph, spread, threshold, p.threshold)


def look_again(graph: Graph, seen: Seen, rest: Bools, parameters: Saliency) -> Look:
    """The same of the ``rest`` (superpixels) alone, by steps 4 to 7: full motion and threshold are its own.

    What did not last in the first look does not last now either.
    """
    p, ties = parameters, seen.ties
    closed = closed_off(graph, ties, seen.motion, rest, p)
    spread = diffuse(ties.weight, closed, p.diffusion.spread, p.diffusion.tolerance, ties.trust)
    threshold = thresholds(graph, spread * seen.lasting, ties.contrast, rest, p.threshold)
    value = log_odds(graph, spread * seen.lasting, threshold, p.threshold)
    return Look(value, score(threshold, p.threshold))


def closed_off(graph: Graph, ties: Ties, motion: OwnMotion, among: Bools, parameters: Saliency) -> Floats:
    """(superpixels) 0 to 1: moves unlike the camera, and is closed off from the border by motion and by colour.

    Parameters
    ----------
    among
        (superpixels) what is looked at; all else is 0.
    """
    scale = parameters.full_motion
    moves = against_full_motion(graph, motion.speed, among, scale)
    both = moves * against_full_motion(graph, motion.enclosed, among, scale)
    return np.asarray(np.sqrt(both) * ties.enclosed * among, np.float64)
