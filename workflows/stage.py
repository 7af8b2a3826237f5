"""What a stage is: an entry that says what it reads and leaves, and a task that computes one part of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video.ignore import read_ignore
from zsmoseg.video.probe import Probe

Array = np.ndarray[Any, Any]
ALL = -1
"""Reach of an input of which every part is needed."""


@dataclass(frozen=True)
class Left:
    """What a task leaves: video arrays (this part's frames or pairs), tables of its own, small facts.

    ``groups`` are written one by one before ``tables``, so a long task may make them as it goes.
    """

    arrays: Mapping[str, Array] = field(default_factory=dict)
    tables: Mapping[str, Array] = field(default_factory=dict)
    groups: Iterable[tuple[str, Mapping[str, Array]]] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """One part of a stage, as its task sees it: only what the stage declared."""

    probe: Probe
    start: int
    stop: int
    settings: SimpleNamespace
    inputs: Mapping[str, Artifact]
    out: str = ""

    @property
    def frames(self) -> int:
        """Frames of the whole video."""
        return len(self.probe.times)

    @property
    def grid(self) -> tuple[int, int]:
        """Height and width of the working grid."""
        return working_size(self.probe, self.settings.frames.width)

    @property
    def ignored(self) -> Array | None:
        """(h, w) true where pixels count for nothing, on the working grid; None without a mask."""
        return self.ignored_at(*self.inputs["frames"].shape("frame")[1:3])

    def ignored_at(self, height: int, width: int) -> Array | None:
        """The same at another size."""
        mask = self.settings.ignore.mask
        return read_ignore(mask, height, width) if mask else None

    @property
    def last_pair(self) -> int:
        """End of the pairs that start in this part."""
        return min(self.stop, self.frames - 1)


@dataclass(frozen=True)
class Stage:
    """The entry of a stage.

    ``inputs`` maps each stage read to its reach: how many frames beyond the part's own, or ``ALL``.
    ``sections`` are the settings read. ``arrays`` tells the video arrays for (probe, settings).
    ``version`` is raised by hand when the values change with equal settings. A stage with ``files``
    leaves them in the output folder instead of an artifact: the names for (probe, start, stop, settings).
    ``cost`` is what a frame of 480p takes on one core where nothing was measured yet: ms and kB
    (``benchmarks/stage_costs.py``); it serves the estimate before a run only.
    """

    name: str
    version: int
    task: Callable[[Task], Left]
    inputs: Mapping[str, int]
    sections: Sequence[str]
    scope: Literal["chunk", "video"] = "chunk"
    arrays: Callable[[Probe, SimpleNamespace], list[ArraySpec]] = lambda probe, settings: []
    files: Callable[[Probe, int, int, SimpleNamespace], list[str]] | None = None
    cost: tuple[float, float] = (0.0, 0.0)

    @property
    def output(self) -> bool:
        """Whether it leaves files for the user."""
        return self.files is not None


def working_size(probe: Probe, width: int) -> tuple[int, int]:
    """(height, width) of the working grid: never larger than the source, sides at least 16."""
    width = min(width, max(probe.width, 16))
    return max(16, round(probe.height * width / probe.width)), max(16, width)
