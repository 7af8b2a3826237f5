"""What several stages read: tables across chunks, pair states, shots."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow import CUT
from zsmoseg.stores.artifact import Artifact


def overlapping(artifact: Artifact, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """(part, its start, its stop) of every part with frames in ``start`` to ``stop - 1``."""
    for i, (a, b) in enumerate(artifact.parts):
        if a < stop and b > start:
            yield i, a, b


def read_states(flow: Artifact, start: int, stop: int) -> NDArray[np.uint8]:
    """State of the pairs ``start`` to ``stop - 1`` (``zsmoseg.flow.STATES``)."""
    parts = [
        flow.read_table(i)["state"][max(start - a, 0) : max(stop - a, 0)]
        for i, a, _ in overlapping(flow, start, stop)
    ]
    return np.concatenate([np.zeros(0, np.uint8), *parts])


def shots(flow: Artifact, frames: int) -> list[tuple[int, int]]:
    """The shots, (start, stop) in frames: what lies between cuts."""
    cuts = (np.flatnonzero(read_states(flow, 0, frames - 1) == CUT) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, frames], strict=True))


@dataclass(frozen=True)
class Span:
    """A shot: its frames, and its objects by global id, the background first."""

    start: int
    stop: int
    objects: NDArray[np.int64]

    @property
    def name(self) -> str:
        """Of its group of tables."""
        return f"{self.start:08d}-{self.stop:08d}"


def spans(objects: Artifact) -> list[Span]:
    """The shots of a video with their objects."""
    table = objects.read_table(0)
    lasts = [0, *map(int, table["last"])]
    return [
        Span(int(a), int(b), np.append(0, np.arange(first + 1, last + 1)))
        for (a, b), first, last in zip(table["shot"], lasts[:-1], lasts[1:], strict=True)
    ]


def local_ids(ids: NDArray[np.int64], span: Span) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Slots of ``ids`` (global) that are objects of the shot, and their number within it."""
    keep = np.flatnonzero(np.isin(ids, span.objects))
    return keep, np.searchsorted(span.objects, ids[keep])
