"""What a run will take, from what the same stages took before."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

from zsmoseg.errors import SpaceError
from zsmoseg.networks.contract import Contract
from zsmoseg.networks.references import contract_at
from zsmoseg.stores import files
from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
from zsmoseg.workflows.stage import working_size

REFERENCE = 480 * 854
PROCESS = 350e6
"""Bytes of a worker that has loaded and compiled everything, and holds nothing (``benchmarks/stage_memory.py``)."""
SHOWN = 12
"""Bytes a pixel of the displayed size that every task may take: some frames as they are decoded."""
RESERVE = 64 * 2**20
"""Bytes of the disk that are left alone."""


@dataclass(frozen=True)
class Estimate:
    """One core's seconds, bytes on disk, whether they were measured here (else: typical figures); bytes of a worker.

    ``videos`` of which the first ``looked`` were looked at.
    """

    seconds: float
    size: int
    measured: bool
    memory: float = 0.0
    looked: int = 0
    videos: int = 0

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(
            self.seconds + other.seconds,
            self.size + other.size,
            self.measured and other.measured,
            max(self.memory, other.memory),
        )

    @property
    def many(self) -> str:
        """How many videos it is of, in words; nothing where all were looked at."""
        return f", by the first {self.looked} of {self.videos} videos" if self.looked < self.videos else ""

    def of(self, looked: int, videos: int) -> Estimate:
        """For ``videos`` videos of which the first ``looked`` take this."""
        scale = videos / max(looked, 1)
        return Estimate(
            self.seconds * scale, int(self.size * scale), self.measured, self.memory, looked, videos
        )


Rates = dict[str, tuple[float, float] | None]
"""Seconds and bytes a frame of 480p by stage, as they were measured; None where they were not."""


def estimate(plans: Sequence[VideoPlan], rates: Rates | None = None) -> Estimate:
    """Sum over all parts to do, by frames and pixels; ``rates`` keeps what was measured from one call to the next."""
    seconds, size, measured = 0.0, 0, True
    rates = {} if rates is None else rates
    for plan in plans:
        for stage in plan.stages.values():
            if not stage.todo:
                continue
            name = stage.stage.name
            if name not in rates:
                rates[name] = _measured(plan, stage)
            scale = stage.frames_todo * plan.probe.width * plan.probe.height / REFERENCE
            measured &= rates[name] is not None
            per_frame, per_size = _rate(stage, rates)
            seconds += per_frame * scale
            size += int(per_size * scale)
    return Estimate(seconds, size, measured, worker_memory(plans))


def _rate(stage: StagePlan, rates: Rates) -> tuple[float, float]:
    """Seconds and bytes a frame of 480p, measured or typical."""
    return rates.get(stage.stage.name) or (stage.stage.cost[0] / 1e3, stage.stage.cost[1] * 1e3)


def part_seconds(plan: VideoPlan, stage: StagePlan, part: int, rates: Rates) -> float:
    """What one part takes."""
    start, stop = stage.parts[part]
    return _rate(stage, rates)[0] * (stop - start) * plan.probe.width * plan.probe.height / REFERENCE


def _measured(plan: VideoPlan, stage: StagePlan) -> tuple[float, float] | None:
    """Seconds and bytes a frame of 480p from finished parts of this stage in this video, other settings too."""
    if stage.artifact is None:
        return None
    frames, seconds, size = 0, 0.0, 0
    for artifact in stage.artifact.siblings():
        for (start, stop), record in zip(
            artifact.parts, map(artifact.part, range(len(artifact.parts))), strict=True
        ):
            if record is not None and "seconds" in record.facts:
                frames += stop - start
                seconds += record.facts["seconds"]
                size += sum(f["size"] for f in record.files.values())
    if not frames:
        return None
    scale = frames * plan.probe.width * plan.probe.height / REFERENCE
    return seconds / scale, size / scale


def refuse_full_disk(store: PurePath, guess: Estimate) -> None:
    """Raise ``SpaceError`` where the plan will not fit."""
    free = files.free(store)
    if free is not None and guess.size + RESERVE > free:
        raise SpaceError(
            f"{store}: the run needs about {guess.size / 1e6:.0f} MB, {free / 1e6:.0f} MB are free; "
            "free some, or give a store on another disk (--store)"
        )


def estimate_line(guess: Estimate) -> str:
    """The estimate in words."""
    kind = "measured here" if guess.measured else "typical figures"
    return (
        f"estimate: {guess.seconds:.0f} s on one core, {guess.size / 1e6:.0f} MB on disk ({kind}{guess.many}), "
        f"at most about {guess.memory / 1e6:.0f} MB of memory a worker"
    )


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
