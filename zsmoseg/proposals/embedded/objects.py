"""The objects of a shot, frame by frame: superpixels that move by themselves, parted and followed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from zsmoseg.proposals.embedded.aliases import Bools, Floats, Ids, Ints, Singles
from zsmoseg.proposals.embedded.components import NONE, tidy
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.graph import Graph, connect_frames
from zsmoseg.proposals.embedded.identities import Identities
from zsmoseg.proposals.embedded.partition import Partition, partition
from zsmoseg.proposals.embedded.saliency import Look, Saliency, first_look, look_again

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
    sure: float = 0.6
    """Mean score over its life that an object has at least which only a later look finds, 0 to 1."""
    halo: int = 2
    """Superpixels around what is found that the next look leaves out, as flow bleeds over borders."""


@dataclass(frozen=True)
class Objects:
    """Parameters of ``find_objects``."""

    saliency: Saliency
    """What moves by itself."""
    partition: Partition
    """What moves apart."""
    selection: Selection
    """What is too little."""


class FrameObjects(NamedTuple):
    """The objects of a frame of n superpixels."""

    value: Singles
    """(n) log-odds of being foreground, in the look that found it."""
    ids: Ids
    """(n) object, 1 upwards and stable over the shot; 0 where there is none."""
    whole: Ids
    """(n) what neighbours hold together, numbered in the same way: of one object, or of several that may move apart."""
    look: Ints
    """(n) the look that found it, 1 = the first; 0 where there is none."""
    sure: Singles
    """(n) mean score over its life of what it is in, in that look."""
    score: float
    """0: nothing moves by itself, to 1: something surely does."""


def find_objects(
    load: Callable[[int, int], SuperpixelFeatures],
    shot: tuple[int, int],
    shape: tuple[int, int],
    objects: Objects,
) -> Iterator[FrameObjects]:
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
    """
    start, stop = shot
    identities, wholes = Identities(), Identities()
    margin = objects.saliency.threshold.window + MARGIN
    for first in range(start, stop, LENGTH):
        last = min(first + LENGTH, stop)
        low, high = max(first - margin, start), min(last + margin, stop)
        graph = connect_frames(load(low, high), low - start, shape)
        found = moving_parts(graph, objects)
        known, named = graph.offset[[first - low, last - low]]
        ids, whole = (
            names.name(part[:named], graph.size[:named], int(known))
            for names, part in ((identities, found.part), (wholes, found.whole))
        )
        for t in range(first - low, last - low):
            here = graph.of(t)
            yield FrameObjects(
                found.value[here].astype(np.float32),
                ids[here.start - known : here.stop - known],
                whole[here.start - known : here.stop - known],
                found.look[here],
                found.sure[here].astype(np.float32),
                float(found.score[t]),
            )


@dataclass(frozen=True)
class Moving:
    """What moves by itself in a window, of all looks together."""

    value: Floats
    """(superpixels) log-odds of being foreground."""
    score: Floats
    """(F) of the first look."""
    part: Ints
    """(superpixels) the part that each is in, or ``components.NONE``."""
    whole: Ints
    """(superpixels) what that is a part of, or ``components.NONE``."""
    look: Ints
    """(superpixels) the look that found it; 0 = none."""
    sure: Floats
    """(superpixels) mean score of the part over its life; 0 where there is none."""


def moving_parts(graph: Graph, objects: Objects) -> Moving:
    """Steps 3 to 11: look, take out what is found, look again at what is left, until nothing sure is found.

    What a later look finds are parts of their own, whatever lies beside them.
    """
    look, seen = first_look(graph, objects.saliency)
    part, whole, sure = parts_of(graph, look, np.ones(len(graph.frame), np.bool_), objects)
    found = Moving(look.value, look.score, part, whole, 1 * (part != NONE), sure)
    new, count, looks = part != NONE, len(graph.frame), 0
    while new.any():
        looks += 1
        free = found.part == NONE
        rest = ~grown(graph, ~free, objects.selection.halo)
        look = look_again(graph, seen, rest, objects.saliency)
        part, whole, sure = parts_of(graph, look, free, objects)
        new = (part != NONE) & (sure >= objects.selection.sure)
        found = Moving(
            np.where(new, look.value, found.value),
            found.score,
            # numbers of their own: what stands for a part of one look may be free, and stand for another's, in the next
            np.where(new, part + looks * count, found.part),
            np.where(new, whole + looks * count, found.whole),
            np.where(new, looks + 1, found.look),
            np.where(new, sure, found.sure),
        )
    return found


def parts_of(graph: Graph, look: Look, free: Bools, objects: Objects) -> tuple[Ints, Ints, Floats]:
    """(superpixels) each: part and whole of the foreground of a look, or ``NONE``; mean score of that part over its life.

    Parameters
    ----------
    free
        (superpixels) what no look before has found.
    """
    score = look.score[graph.frame]
    foreground = free & (look.value > 0) & (score >= objects.selection.score)
    smallest = objects.selection.smallest * graph.shape[0] * graph.shape[1]
    whole, part = partition(graph, foreground, objects.partition)
    part = tidy(foreground, part, graph.size, graph.edge, smallest)
    mine = part != NONE
    total, pixels = (np.bincount(part[mine], x[mine], len(part)) for x in (graph.size * score, graph.size))
    return part, np.where(mine, whole, NONE), np.where(mine, (total / np.maximum(pixels, 1))[part], 0.0)


def grown(graph: Graph, nodes: Bools, steps: int) -> Bools:
    """(superpixels) the ``nodes`` and what is up to ``steps`` neighbours away from them in their frame."""
    i, j = graph.edge.T
    for _ in range(steps):
        wider = nodes.copy()
        wider[i[nodes[j]]] = wider[j[nodes[i]]] = True
        nodes = wider
    return nodes
