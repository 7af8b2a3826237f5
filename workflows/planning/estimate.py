"""What a run will take, from what the same stages took before."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

from zsmoseg.errors import SpaceError
from zsmoseg.networks.contract import Contract
from zsmoseg.networks.references import contract_at
from zsmoseg.stores import files
from zsmoseg.workflows.planning.compiled import EACH
from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
from zsmoseg.workflows.planning.rates import Rate, Rates, Use, kept_work, work
from zsmoseg.workflows.stage import working_size
from zsmoseg.workflows.wording import counted, duration, megabytes

PROCESS = 350e6
"""Bytes of a worker that has loaded and compiled everything, and holds nothing (``benchmarks/stage_memory.py``)."""
SHOWN = 12
"""Bytes a pixel of the displayed size that every task may take: some frames as they are decoded."""
EACH_PART = 0.013
"""Seconds that a part takes however small it is (12 frames of 48 x 64 in 31 parts: 0.41 s)."""
RESERVE = 64 * 2**20
"""Bytes of the disk that are left alone."""


@dataclass(frozen=True)
class Estimate:
    """What a run takes.

    Attributes
    ----------
    seconds, wall
        Of all tasks: of the processor, and by the clock, one after the other.
    chain
        Seconds by the clock of what cannot be done at once.
    size, memory
        Bytes on disk, and of a worker.
    measured
        All rates were measured on this machine; else some are typical figures.
    compiles
        Functions that must be compiled first.
    looked, videos
        The ``videos`` are judged by the first ``looked`` of them.
    lasts, workers
        Seconds from here to the end, with so many workers; None where nobody knows how many there will be.
    """

    seconds: float = 0.0
    wall: float = 0.0
    chain: float = 0.0
    size: int = 0
    memory: float = 0.0
    measured: bool = True
    compiles: frozenset[str] = frozenset()
    looked: int = 0
    videos: int = 0
    lasts: float | None = None
    workers: int = 1

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(
            self.seconds + other.seconds,
            self.wall + other.wall,
            max(self.chain, other.chain),
            self.size + other.size,
            max(self.memory, other.memory),
            self.measured and other.measured,
            self.compiles | other.compiles,
        )

    @property
    def many(self) -> str:
        """How many videos it is of, in words; nothing where all were looked at."""
        return f", by the first {self.looked} of {self.videos} videos" if self.looked < self.videos else ""

    @property
    def compiling(self) -> float:
        """Seconds that compiling takes."""
        return EACH * len(self.compiles)

    def of(self, looked: int, videos: int) -> Estimate:
        """For ``videos`` videos of which the first ``looked`` take this."""
        scale = videos / max(looked, 1)
        return replace(
            self,
            seconds=self.seconds * scale,
            wall=self.wall * scale,
            size=int(self.size * scale),
            looked=looked,
            videos=videos,
        )

    def with_workers(self, workers: int, use: Use) -> Estimate:
        """How long it lasts on so many workers of one kind."""
        lasts = use.start + self.compiling + max(self.wall / workers / use.share, self.chain)
        return replace(self, lasts=lasts, workers=workers)


def estimate(plans: Sequence[VideoPlan], rates: Rates) -> Estimate:
    """Sum over all parts to do, by frames and pixels."""
    guess = Estimate()
    for plan in plans:
        chain = 0.0
        for stage in plan.stages.values():
            if not stage.todo:
                continue
            rate, lengths = rates.of(stage), stage.lengths_todo
            frames = work(plan, stage, sum(lengths))
            overhead = EACH_PART * len(stage.todo)
            longest = part_seconds(plan, stage, max(zip(lengths, stage.todo, strict=True))[1], rate)
            chain += rate.wall * frames + overhead if stage.stage.follows else longest
            guess += Estimate(
                rate.processor * frames + overhead,
                rate.wall * frames + overhead,
                size=int(rate.size * kept_work(plan, stage, sum(lengths))),
                measured=rate.measured,
                compiles=rates.missing(stage.stage.task.__module__),
            )
        guess += Estimate(chain=chain)
    return guess + Estimate(memory=worker_memory(plans))


def part_seconds(plan: VideoPlan, stage: StagePlan, part: int, rate: Rate) -> float:
    """What one part takes by the clock, at the rate of its stage."""
    start, stop = stage.parts[part]
    return rate.wall * work(plan, stage, stop - start) + EACH_PART


def refuse_full_disk(store: PurePath, guess: Estimate) -> None:
    """Raise ``SpaceError`` where the plan will not fit."""
    free = files.free(store)
    if free is not None and guess.size + RESERVE > free:
        raise SpaceError(
            f"{store}: the run needs about {guess.size / 1e6:.0f} MB, {free / 1e6:.0f} MB are free; "
            "free some, or give a store on another disk (--store)"
        )


def estimate_lines(guess: Estimate) -> list[str]:
    """The estimate in words."""
    if not guess.wall:
        return ["nothing to do"]
    kind = "measured on this machine" if guess.measured else "typical figures"
    workers = f" with {counted(guess.workers, 'worker')}" if guess.workers > 1 else ""
    lasts = "" if guess.lasts is None else f"about {duration(guess.lasts)}{workers}, "
    line = (
        f"estimate: {lasts}{duration(guess.seconds)} of processor time, {megabytes(guess.size)} on disk "
        f"({kind}{guess.many}), at most about {megabytes(guess.memory)} of memory a worker"
    )
    compiling = [f"compiling, once, about {duration(guess.compiling)}"] if guess.compiles else []
    return [line, *compiling]


def models_of(plans: Sequence[VideoPlan]) -> set[str]:
    """References of the networks that have something to do."""
    return {model for plan in plans for stage in plan.stages.values() if stage.todo for model in stage.models}


def task_memory(plan: VideoPlan, stage: StagePlan) -> float:
    """Bytes that a part of a stage takes beyond its process, its networks left out; it does not grow with the video."""
    probe, frames = plan.probe, max(stop - start for start, stop in stage.parts)
    height, width = working_size(probe, plan.stages["frames"].given.frames.width)
    shown = probe.height * probe.width
    sections = stage.stage.chosen(stage.given)
    if stage.stage.nothing(sections):
        return 0.0
    return stage.stage.memory.of(frames, sections, height * width, shown) + SHOWN * shown


def worker_memory(plans: Sequence[VideoPlan]) -> float:
    """Bytes that a worker takes at most for what is to do, about: its largest task, and its largest network."""
    tasks = [task_memory(plan, stage) for plan in plans for stage in plan.stages.values() if stage.todo]
    networks = [_memory(contract_at(model)) for model in models_of(plans)]
    return PROCESS + max(tasks, default=0.0) + max(networks, default=0.0)


def fitting_workers(plans: Sequence[VideoPlan]) -> int:
    """Workers of this machine: as many as it has cores, as far as its memory goes."""
    import psutil

    return max(1, min(cores(None), int(psutil.virtual_memory().available // worker_memory(plans))))


def _memory(contract: Contract) -> float:
    """Bytes that a network takes: as its contract says, else weights twice and as much for what runs through them."""
    if contract.memory_mb is not None:
        return contract.memory_mb * 1e6
    return 4.0 * sum((contract.folder / file.file).stat().st_size for file in contract.files)


def cores(workers: int | None) -> int:
    """Workers that a local run uses."""
    if workers:
        return workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
