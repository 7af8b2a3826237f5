"""What a stage is: an entry that says what it reads and leaves, and a task that computes one part of it.

A stage is one file: a dataclass of what it leaves (``Arrays``), one of what it reads (``Inputs``), one of the
settings that it reads (``Sections``), its task, and ``STAGE``. A task gets nothing else, and mypy sees it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any, Generic, Literal, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.errors import NetworkError
from zsmoseg.networks.session import Network, open_network
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.beginning import plan_of
from zsmoseg.stores.fields import LABELS, Grid, videos_of
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.video.frames import read
from zsmoseg.video.ignore import describe_ignore, read_ignore
from zsmoseg.video.probe import Probe

ALL = -1
"""Reach of an input of which every part is needed."""


def reach(frames: int = 0) -> Any:
    """An input, read so many frames beyond the part's own; ``ALL``: the whole video."""
    return dataclasses.field(metadata={"reach": frames})


@dataclass(frozen=True)
class Part:
    """One part of a stage: frames ``start`` to ``stop - 1`` of a video.

    Attributes
    ----------
    out
        The output folder, for stages that leave files.
    facts
        What the task notes for the record, JSON types.
    networks
        Where networks run, and with how many threads.
    opened
        The networks that were used, and the seconds that opening had cost them before.
    decoded
        The frames that were read from the source.
    before
        What the part before this one left, of a stage that ``follows``; None at the first.
    """

    probe: Probe
    start: int
    stop: int
    out: PurePath = Path()
    facts: dict[str, Any] = field(default_factory=dict)
    networks: settings.Networks = field(default_factory=settings.Networks)
    opened: dict[str, tuple[Network, float]] = field(default_factory=dict, repr=False)
    decoded: list[tuple[int, int]] = field(default_factory=list, repr=False)
    before: Any = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Frames of the whole video."""
        return len(self.probe.times)

    @property
    def last_pair(self) -> int:
        """End of the pairs that start in this part."""
        return min(self.stop, self.frames - 1)

    @property
    def displayed(self) -> tuple[int, int]:
        """Height and width of the frames as displayed."""
        return self.probe.height, self.probe.width

    def images(self, start: int, stop: int) -> Iterator[NDArray[np.uint8]]:
        """Frames ``start`` to ``stop - 1`` of the source as displayed: (H, W, 3) blue green red.

        The one way to the source: what was read must turn out to be what the key says (``running/trust.py``).
        """
        self.decoded.append((start, stop))
        return read(self.probe, start, stop)

    def read(self, frame: int) -> NDArray[np.uint8]:
        """One frame as displayed: (H, W, 3) blue green red."""
        return next(self.images(frame, frame + 1))

    @property
    def batch(self) -> int:
        """Frames that a network may take at once."""
        return self.networks.batch

    def network(self, reference: str) -> Network:
        """The network of a pinned reference: one of each in a process, opened when it first runs."""
        network = open_network(reference, self.networks.provider, max(self.networks.threads, 1))
        self.opened.setdefault(reference, (network, network.warm_up))
        return network

    @property
    def warm_up(self) -> float:
        """Seconds that went into opening networks: no part of what a frame takes."""
        return sum(network.warm_up - before for network, before in self.opened.values())

    @contextmanager
    def at_frame(self, frame: int) -> Iterator[None]:
        """Around the run of a network: what fails names the frame."""
        try:
            yield
        except NetworkError as error:
            raise type(error)(f"frame {self.probe.names[frame]}: {error}") from error


def ignored(section: settings.Ignore, height: int, width: int) -> NDArray[np.bool_] | None:
    """(height, width) true where pixels count for nothing; None without a mask."""
    return read_ignore(section.mask, height, width) if section.mask else None


def ignored_words(section: settings.Ignore, height: int, width: int) -> list[str]:
    """What is ignored of frames of the displayed size, in words; nothing without a mask.

    Raises
    ------
    SettingsError
        The mask does not fit, or leaves nothing.
    """
    return [describe_ignore(section.mask, height, width)] if section.mask else []


I = TypeVar("I")  # noqa: E741
S = TypeVar("S")
Task = Callable[[Part, I, S], Iterable[Arrays]]
"""Yields what it leaves, a run of frames at a time; a stage that leaves files notes them in ``facts``."""


@dataclass(frozen=True)
class Memory(Generic[S]):
    """What a task holds at once, as measured: ``benchmarks/stage_memory.py``.

    Attributes
    ----------
    working, shown
        Bytes a pixel of the working grid, and of the displayed size, for each frame that it holds.
    frames
        Frames that it holds at most, by its sections; None: all of its part.
    """

    working: float = 0.0
    shown: float = 0.0
    frames: Callable[[S], int] | None = None

    def of(self, frames: int, sections: S, working: int, shown: int) -> float:
        """Bytes of a part of ``frames`` frames, of so many pixels."""
        held = frames if self.frames is None else min(frames, self.frames(sections))
        return held * (self.working * working + self.shown * shown)


@dataclass(frozen=True)
class Stage(Generic[I, S]):
    """The entry of a stage.

    Attributes
    ----------
    version
        Raised by hand when the values change with equal settings.
    leaves
        What its artifact holds; None where it leaves files in the output folder.
    inputs
        A dataclass: each field the artifact of the stage of that name, with its ``reach``.
    sections
        A dataclass: each field the section of the settings of that name.
    scope
        A part is a chunk, or the whole video.
    files
        Names of the files that it leaves for frames start to stop, for (probe, start, stop, sections).
    labels
        Labels of dimensions that depend on the settings.
    span
        Frames that belong together: a part holds whole spans.
    least
        Frames of a part at least, whatever the chunks are.
    follows
        Whether a part goes on from what the one before it left.
    nothing
        Whether it leaves no array with these settings.
    cost
        What a frame of 480p takes on one core where nothing was measured yet: ms and kB
        (``benchmarks/stage_costs.py``); it serves the estimate before a run only.
    memory
        What a task holds at once, beside the objects' tables and the networks.
    """

    name: str
    version: int
    task: Task[I, S]
    inputs: type[I]
    sections: type[S]
    leaves: type[Arrays] | None = None
    scope: Literal["chunk", "video"] = "chunk"
    files: Callable[[Probe, int, int, S], list[str]] | None = None
    labels: Callable[[S], Mapping[str, Sequence[str]]] = lambda sections: {}
    span: Callable[[S], int] = lambda sections: 1
    least: int = 1
    follows: bool = False
    nothing: Callable[[S], bool] = lambda sections: False
    cost: tuple[float, float] = (0.0, 0.0)
    memory: Memory[S] = field(default_factory=Memory)

    @property
    def output(self) -> bool:
        """Whether it leaves files for the user."""
        return self.files is not None

    @cached_property
    def reaches(self) -> dict[str, int]:
        """The stages that it reads, and how many frames beyond the part's own."""
        return {f.name: f.metadata["reach"] for f in dataclasses.fields(self.inputs)}  # type: ignore[arg-type]

    @cached_property
    def reads(self) -> dict[str, type[Arrays]]:
        """The stages that it reads, and as what."""
        return get_type_hints(self.inputs)

    @cached_property
    def section_names(self) -> tuple[str, ...]:
        """The sections of the settings that it reads."""
        return tuple(f.name for f in dataclasses.fields(self.sections))  # type: ignore[arg-type]

    def chosen(self, given: settings.Settings) -> S:
        """The sections that it reads, of all settings."""
        return self.sections(**{name: getattr(given, name) for name in self.section_names})

    def video_arrays(self, probe: Probe, given: settings.Settings) -> list[ArraySpec]:
        """The arrays whose size is known before anything is computed."""
        if self.leaves is None or self.nothing(self.chosen(given)):
            return []
        frames = len(probe.times)
        fixed = {dim: len(text) for dim, text in LABELS.items()}
        sizes = {"frame": frames, "pair": frames - 1, **fixed}
        width = given.frames.width if "frames" in self.section_names else None
        return [
            ArraySpec.of(name, declared, {**sizes, **_grid(probe, declared.grid, width)})
            for name, declared in videos_of(self.leaves).items()
        ]


def description(
    stage: Stage[Any, Any],
    key: str,
    given: Mapping[str, Any],
    inputs: Mapping[str, str],
) -> dict[str, Any]:
    """What is written beside a result, so that a later plan can say what changed.

    Parameters
    ----------
    given
        The settings that it reads, by section.
    inputs
        Keys of the stages that it reads.
    """
    return {
        "stage": stage.name,
        "version": stage.version,
        "key": key,
        "settings": dict(given),
        "inputs": dict(inputs),
    }


def first_record(
    stage: Stage[Any, Any],
    about: Mapping[str, Any],
    fingerprint: str,
    probe: Probe,
    parts: Sequence[tuple[int, int]],
) -> dict[str, Any]:
    """The first record of the artifact of a stage (``beginning.plan_of``); ``about``: its ``description``."""
    given = settings.Settings.model_validate(about["settings"])
    labels = {dim: list(text) for dim, text in stage.labels(stage.chosen(given)).items()}
    told = {**about, "fingerprint": fingerprint, "labels": labels}
    return plan_of(told, parts, stage.video_arrays(probe, given))


def _grid(probe: Probe, grid: Grid | None, width: int | None) -> dict[str, int]:
    """Rows and columns of a video array; of the working grid only where the stage reads how wide that is."""
    if grid == "displayed":
        return {"y": probe.height, "x": probe.width}
    assert width is not None, "a stage that leaves arrays on the working grid reads the section frames"
    height, width = working_size(probe, width)
    return {"y": height, "x": width}


SMALLEST = 16
"""px, sides of the working grid: patches of the flow are 8 px wide."""


def working_size(probe: Probe, width: int) -> tuple[int, int]:
    """(height, width) of the working grid: never larger than the source, sides at least ``SMALLEST``."""
    width = min(width, max(probe.width, SMALLEST))
    return max(SMALLEST, round(probe.height * width / probe.width)), max(SMALLEST, width)
