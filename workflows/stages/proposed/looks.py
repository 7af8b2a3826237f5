"""At which frames networks look: the first of every span, and the first behind a cut."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.flow.pairs import CUT
from zsmoseg.workflows.stages.cues.flow import Flow


def looks(flow: Flow, start: int, stop: int, span: int) -> NDArray[np.int64]:
    """The frames of ``start`` to ``stop - 1`` that are looked at; ``start`` begins a span."""
    frames = np.arange(start, stop)
    state = flow.state
    after = np.zeros(len(frames), np.bool_)
    cuts = np.flatnonzero(state == CUT) + 1
    after[cuts[cuts < len(frames)]] = True
    return np.asarray(frames[(frames % span == 0) | after])


def span_of(sections: Any) -> int:
    """Frames of a span, by settled settings: parts are whole spans."""
    span: int = sections.looks.span
    return span
