"""Motion that is closed off from the border of the frame, by motion and by colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zsmoseg.proposals.embedded.aliases import Floats
from zsmoseg.proposals.embedded.geodesic import from_border
from zsmoseg.proposals.embedded.graph import Graph


@dataclass(frozen=True)
class Enclosure:
    """What closes off."""

    flow_noise: float
    """Steps of the flow below this are no boundary, px."""
    border_entry: float
    """Cost of entering at the border, px per px of own motion: objects may reach out of the frame."""
    border_colour: float
    """Colour path from the border that counts 63 % as closed, Lab."""


def enclosed_by_colour(graph: Graph, enclosure: Enclosure) -> Floats:
    """(superpixels) 0 to 1: whether every path from the border of the frame changes colour."""
    free = np.zeros(len(graph.frame))
    return np.asarray(1 - np.exp(-from_border(graph, graph.edge_colour, free) / enclosure.border_colour))


def enclosed_by_motion(graph: Graph, speed: Floats, enclosure: Enclosure) -> Floats:
    """(superpixels) px: the least change of the flow on a path from the border of the frame.

    Parameters
    ----------
    speed
        (superpixels) length of the own motion, px.
    """
    forward, backward = graph.edge_flow
    step = np.maximum((forward + backward) / 2 - enclosure.flow_noise, 0)
    return np.asarray(from_border(graph, step, enclosure.border_entry * speed), np.float64)
