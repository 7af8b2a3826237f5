"""How far a superpixel's motion can be seen: flow is carried on from objects into what has no detail beside them.

Source of what a motion changes in the picture: Lucas, Kanade, "An iterative image registration technique with an
application to stereo vision", IJCAI 1981.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats
from zsmoseg.proposals.embedded.camera import Motion
from zsmoseg.proposals.embedded.features_loops import CHANGE
from zsmoseg.proposals.embedded.graph import Graph

NOISE = 1.0
"""Squared change of the detail that is noise, grey levels²."""


@dataclass(frozen=True, kw_only=True)
class Trust:
    """How far motion is trusted without texture."""

    trust_texture: float
    """Slope of the grey level at which motion is half trusted, grey levels / px."""
    trust_least: float = 0.05
    """Trust where there is no texture, 0 to 1. Halved or doubled it changes J by 0.04 at most."""
    trust_unknown: float = 1e-3
    """Trust where there is no flow: only its neighbours decide, but the equations stay definite."""


@dataclass(frozen=True)
class Visibility:
    """What motion must show."""

    show_detail: float
    """Squared change at which a superpixel could show its motion half, grey levels²."""
    show_excess: float
    """How much more its motion explains than it leaves, at which it counts half."""


def trust(graph: Graph, parameters: Trust) -> Floats:
    """(superpixels) above 0 to 1: how far its motion is trusted against that of those around."""
    xx, _, yy = graph.structure.T
    texture = (xx + yy) / 2
    found = np.maximum(texture / (texture + parameters.trust_texture**2), parameters.trust_least)
    return np.where(graph.has_flow, found, parameters.trust_unknown)


def visibility(graph: Graph, own: Motion, full: Floats, parameters: Visibility) -> Floats:
    """(superpixels) 0 to 1: whether its own motion shows in the picture.

    In what has no detail of its own (sky, shadow, water) the camera's motion explains the picture as well as the
    flow does. What the own motion d would change is d' G d, G the structure tensor, and at most twice the detail, as
    of two pictures that have nothing to do with each other; it is compared with what the flow leaves unexplained.
    This counts as far as a superpixel has the detail to show the motion of the objects in its frame.

    Parameters
    ----------
    own
        As ``camera.own_motion`` gives it.
    full
        (F) full motion of each frame, px.
    """
    (xx, xy, yy), most = graph.structure.T, 2 * graph.detail
    changed = sum(
        np.minimum(xx * d[:, 0] ** 2 + 2 * xy * d[:, 0] * d[:, 1] + yy * d[:, 1] ** 2, most) / 2 for d in own
    )
    left = (graph.forward[:, CHANGE] + graph.backward[:, CHANGE]) / 2
    excess = np.maximum((changed + NOISE) / (left + NOISE) - 1, 0)
    would = np.minimum((xx + yy) / 2 * full[graph.frame] ** 2, most)
    shown = would / (would + parameters.show_detail)
    return np.asarray(1 - shown / (1 + excess / parameters.show_excess))
