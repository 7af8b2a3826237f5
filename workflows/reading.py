"""What several stages read: tables across chunks, pair states, shots."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from zsmoseg.stores.artifact import Artifact
from zsmoseg.tables import CUT


def overlapping(artifact: Artifact, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """(part, its start, its stop) of every part with frames in ``start`` to ``stop - 1``."""
    for i, (a, b) in enumerate(artifact.parts):
        if a < stop and b > start:
            yield i, a, b


def read_states(flow: Artifact, start: int, stop: int) -> NDArray[np.uint8]:
    """State of the pairs ``start`` to ``stop - 1`` (``zsmoseg.tables.STATES``)."""
    parts = [
        flow.read_table(i)["state"][max(start - a, 0) : max(stop - a, 0)]
        for i, a, _ in overlapping(flow, start, stop)
    ]
    return np.concatenate([np.zeros(0, np.uint8), *parts])


def shots(flow: Artifact, frames: int) -> list[tuple[int, int]]:
    """The shots, (start, stop) in frames: what lies between cuts."""
    cuts = (np.flatnonzero(read_states(flow, 0, frames - 1) == CUT) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, frames], strict=True))
