"""The objects of a shot, frame by frame: superpixels that move by themselves, parted and followed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from zsmoseg.proposals.embedded.aliases import Ids, Ints, Singles
from zsmoseg.proposals.embedded.components import tidy
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.graph import Graph, connect_frames
from zsmoseg.proposals.embedded.identities import Identities
from zsmoseg.proposals.embedded.partition import Partition, partition
from zsmoseg.proposals.embedded.saliency import Judgement, Saliency, judge

LENGTH = 160
"""Frames that are decided on at once."""
MARGIN = 30
"""Frames beyond the window of the threshold that are looked at on both sides of them."""


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What of the foreground is objects."""

    score: float = 0.3
    """A frame with less is empty, 0 to 1. Halved or doubled it changes J by nothing."""
    smallest: float = 0.0005
    """Smallest connected piece, share of the frame. Halved or doubled it changes J by 0.2 at most."""


@dataclass(frozen=True)
class Objects:
    """Parameters of ``find_objects``."""

    saliency: Saliency
    """What moves by itself."""
    partition: Partition
    """What moves apart."""
    selection: Selection
    """What is too little."""


def find_objects(
    load: Callable[[int, int], SuperpixelFeatures],
    shot: tuple[int, int],
    shape: tuple[int, int],
    objects: Objects,
) -> Iterator[tuple[Singles, Ids, float]]:
    """The objects of a shot, frame by frame.

    The shot is worked on in windows of ``LENGTH`` frames, counted from its start, so memory does not grow with it.

    Parameters
    ----------
    load
        ``load(a, b)`` gives the features of the frames a to b - 1 and of the pairs inside them.
    shot
        First frame, and the one after the last; no cut inside.
    shape
        Height and width of the working grid, px.
    objects
        The parameters.

    Yields
    ------
    value
        (superpixels) log-odds of being foreground.
    ids
        (superpixels) object, 1 upwards and stable over the shot; 0 where there is none.
    score
        0: nothing moves by itself, to 1: something surely does.
    """
    start, stop = shot
    identities = Identities()
    margin = objects.saliency.threshold.window + MARGIN
    for first in range(start, stop, LENGTH):
        last = min(first + LENGTH, stop)
        low, high = max(first - margin, start), min(last + margin, stop)
        graph = connect_frames(load(low, high), low - start, shape)
        judgement = judge(graph, objects.saliency)
        part = moving_parts(graph, judgement, objects)
        known, named = graph.offset[[first - low, last - low]]
        ids = identities.name(part[:named], graph.size[:named], int(known))
        for t in range(first - low, last - low):
            here = graph.of(t)
            value = judgement.value[here].astype("float32")
            yield value, ids[here.start - known : here.stop - known], float(judgement.score[t])


def moving_parts(graph: Graph, judgement: Judgement, objects: Objects) -> Ints:
    """(superpixels) step 10: the part of the foreground that each is in, or ``components.NONE``."""
    foreground = (judgement.value > 0) & (judgement.score >= objects.selection.score)[graph.frame]
    smallest = objects.selection.smallest * graph.shape[0] * graph.shape[1]
    part = partition(graph, foreground, objects.partition)
    return tidy(foreground, part, graph.size, graph.edge, smallest)
