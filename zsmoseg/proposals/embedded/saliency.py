"""Which superpixels move by themselves, over a window of frames: the steps of ``docs/embedded.md`` from 3 to 9.

What sets them apart: motion that is not the camera's and is closed off from the border of the frame, spread over
like neighbours in space and time, cut where motion and colour both change, and confirmed by colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from zsmoseg.proposals.embedded.aliases import Floats
from zsmoseg.proposals.embedded.bilateral_grid import BilateralGrid, smooth
from zsmoseg.proposals.embedded.camera import Camera, own_motion, speed
from zsmoseg.proposals.embedded.diffusion import Diffusion, diffuse, similarity
from zsmoseg.proposals.embedded.enclosure import Enclosure, enclosed_by_colour, moving
from zsmoseg.proposals.embedded.full_motion import FullMotion, full
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
class Judgement:
    """What is found out about a window."""

    value: Floats
    """(superpixels) log-odds of being foreground: log(saliency / threshold) / softness."""
    score: Floats
    """(F) 0: nothing moves by itself, to 1: something surely does."""


@dataclass(frozen=True)
class _Known:
    """What is the same in all steps."""

    weight: sp.csr_array
    """(superpixels, superpixels) of the diffusion."""
    trust: Floats
    """(superpixels) in motion."""
    enclosed: Floats
    """(superpixels) by colour."""
    contrast: Floats
    """(edges)."""


def judge(graph: Graph, parameters: Saliency) -> Judgement:
    """Value of every superpixel and score of every frame of a window.

    The camera's motion is fitted twice: to everything, then to what has not turned out to be foreground. So an
    object that fills most of a frame does not pass for the background where the frames around know it.
    """
    p = parameters
    known = _Known(
        weight=similarity(graph, p.diffusion),
        trust=trust(graph, p.trust),
        enclosed=enclosed_by_colour(graph, p.enclosure),
        contrast=boundary_contrast(graph, p.contrast),
    )
    guess = first_guess(graph, known, p)
    # 3. own motion beyond the camera's
    own = own_motion(graph, graph.size * (1 - guess), p.camera)
    own_speed = speed(graph, own)
    # 4. closed off by motion and by colour
    closed = moving(graph, own_speed, p.full_motion, p.enclosure) * known.enclosed
    # 5. diffusion: of all of it, and of what comes from flow that closes
    both = np.stack([closed, closed * cleanness(graph, own_speed, p.cleanness)], 1)
    spread, clean = diffuse(known.weight, both, p.diffusion.spread, p.diffusion.tolerance, known.trust).T
    # 6. persistence
    window, bins = p.threshold.window, p.threshold.threshold_bins
    lasting = spread * persistence(graph, spread, clean, p.persistence, window, bins)
    # 7. threshold, and the score of the frames
    threshold = thresholds(graph, lasting, known.contrast, p.threshold)
    foreground = probability(graph, lasting, threshold, p.threshold)
    # 8. visibility
    top = full(graph, own_speed, p.full_motion)
    seen = foreground * visibility(graph, own, top, p.visibility)
    # 9. appearance, then diffusion and threshold once more
    confirmed = (seen + smooth(graph, foreground, p.bilateral_grid)) / 2
    saliency = diffuse(known.weight, confirmed, p.diffusion.spread, p.diffusion.tolerance)
    last_threshold = thresholds(graph, saliency, known.contrast, p.threshold)
    value = log_odds(graph, saliency, last_threshold, p.threshold)
    return Judgement(value, score(threshold, p.threshold))


def first_guess(graph: Graph, known: _Known, parameters: Saliency) -> Floats:
    """(superpixels) 0 to 1: foreground by steps 3 to 7 but for persistence, the camera fitted to everything."""
    p = parameters
    own = own_motion(graph, graph.size, p.camera)
    closed = moving(graph, speed(graph, own), p.full_motion, p.enclosure) * known.enclosed
    spread = diffuse(known.weight, closed, p.diffusion.spread, FIRST_TOLERANCE, known.trust)
    first_threshold = thresholds(graph, spread, known.contrast, p.threshold)
    return probability(graph, spread, first_threshold, p.threshold)
