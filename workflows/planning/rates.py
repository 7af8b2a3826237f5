"""What stages took on this machine, kept in the user's cache folder from run to run, for the estimate before the next.

A small record of sums for this machine, these versions and this installation; without it, or where it cannot be written,
estimates go by typical figures.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import PurePath
from typing import Any

from platformdirs import user_cache_path

import zsmoseg
from zsmoseg.errors import ZsmosegError
from zsmoseg.stores import files
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.runs import versions
from zsmoseg.workflows.planning.compiled import missing
from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
from zsmoseg.workflows.stage import working_size
from zsmoseg.workflows.stages.graph import GRAPHS

DISPLAYED, GRID = 480 * 854, 240 * 427
"""Pixels of the frame, and of the working grid, that costs are of."""
FADING = 0.5
"""What sums of earlier runs count beside those of the latest."""
STARTING = {"serial": 0.0, "local": 2.5}
"""Seconds until an executor is there, where they were not measured."""
LOADING = {"serial": 0.5, "local": 2.5}
"""Seconds that its processes then take to load what tasks need."""
LEAST = 1.0
"""Frames of 480p from which a part tells a rate: of a smaller one its own overhead is most."""
LONG = 10.0
"""Seconds that tasks must have taken for a run to tell how well workers are used."""


@dataclass
class Taken:
    """Sums: seconds of the processor and of the wall clock over ``work``, bytes over ``kept`` (frames of 480p)."""

    processor: float = 0.0
    wall: float = 0.0
    work: float = 0.0
    size: float = 0.0
    kept: float = 0.0

    def add(self, other: Taken, scale: float = 1.0) -> None:
        """Count another, by ``scale``."""
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + scale * getattr(other, f.name))


@dataclass(frozen=True)
class Rate:
    """What a frame of 480p takes: seconds of the processor and of the wall clock, bytes; measured here or typical."""

    processor: float
    wall: float
    size: float
    measured: bool


@dataclass
class Use:
    """How a kind of executor was used: seconds until it is there; those of tasks, and those of its workers."""

    start: float
    useful: float = 0.0
    paid: float = 0.0

    @property
    def share(self) -> float:
        """Part of the workers' time that tasks had."""
        return min(1.0, self.useful / self.paid) if self.paid else 1.0


@dataclass
class Rates:
    """What is known, and what this run adds."""

    stages: dict[str, Taken] = field(default_factory=dict)
    uses: dict[str, Use] = field(default_factory=dict)
    new: dict[str, Taken] = field(default_factory=dict)
    uncompiled: dict[str, frozenset[str]] = field(default_factory=dict)

    def of(self, stage: StagePlan) -> Rate:
        """Of a stage with these settings; else with others; else typical, at the speed of this machine."""
        exact, front = name_of(stage), _front(stage.stage.name, stage.stage.version)
        known = self.stages.get(exact) or _sum(t for n, t in self.stages.items() if n.startswith(front))
        milliseconds, kilobytes = stage.stage.cost
        size = known.size / known.kept if known.kept else kilobytes * 1e3
        if known.work:
            return Rate(known.processor / known.work, known.wall / known.work, size, True)
        typical = milliseconds / 1e3 * self.speed
        return Rate(typical, typical, size, False)

    @property
    def speed(self) -> float:
        """Seconds that this machine takes for one that is typical."""
        costs = {_front(s.name, s.version): s.cost[0] / 1e3 for g in GRAPHS.values() for s in g.values()}
        known = [(t, costs.get(n.rpartition(" ")[0] + " ", 0.0)) for n, t in self.stages.items() if t.work]
        typical = sum(t.work * cost for t, cost in known)
        return sum(t.processor for t, cost in known if cost) / typical if typical else 1.0

    def use(self, kind: str) -> Use:
        """Of an executor, with what its processes load."""
        use = self.uses.get(kind) or Use(STARTING.get(kind, 0.0))
        return replace(use, start=use.start + LOADING.get(kind, 0.0))

    def used(self, kind: str, start: float, useful: float, paid: float) -> None:
        """Count how this run used its executor."""
        if kind in STARTING:
            before = self.uses.get(kind, Use(start))
            long = useful >= LONG
            self.uses[kind] = Use(
                start,
                FADING * before.useful + useful if long else before.useful,
                FADING * before.paid + paid if long else before.paid,
            )

    def missing(self, module: str) -> frozenset[str]:
        """Functions that a stage's module must have compiled; looked for once a run."""
        if module not in self.uncompiled:
            self.uncompiled[module] = missing(module)
        return self.uncompiled[module]

    def add(self, stage: StagePlan, taken: Taken) -> None:
        """Count a part of this run, unless it is too small to tell anything."""
        if not 0 < taken.work < LEAST:
            self.new.setdefault(name_of(stage), Taken()).add(taken)

    def sized(self, stage: StagePlan, taken: Taken) -> None:
        """Count the bytes of an artifact of which parts were computed in this run."""
        if name_of(stage) in self.new:
            self.add(stage, taken)

    def keep(self) -> None:
        """Add what is new to what other runs have kept meanwhile; where that cannot be written nothing happens."""
        if not self.new:
            return
        before = Rates.load()
        for name, taken in before.stages.items():
            if name in self.new:
                self.new[name].add(taken, FADING)
        stages = {name: asdict(taken) for name, taken in (before.stages | self.new).items()}
        uses = {kind: asdict(use) for kind, use in (before.uses | self.uses).items()}
        try:
            files.make_folder(place().parent)
            write_record(place(), {"stages": stages, "uses": uses})
        except (OSError, ZsmosegError):
            return

    @classmethod
    def load(cls) -> Rates:
        """What is kept for this machine."""
        record = read_record(place()) or {}
        try:
            stages = {name: Taken(**_numbers(t)) for name, t in record.get("stages", {}).items()}
            uses = {kind: Use(**_numbers(use)) for kind, use in record.get("uses", {}).items()}
        except (AttributeError, TypeError, ValueError):
            return cls()
        return cls(stages, uses)


def place() -> PurePath:
    """The record of this machine, these versions and this installation."""
    about = [platform.node(), platform.machine(), os.cpu_count(), versions(), zsmoseg.__file__]
    return user_cache_path("zsmoseg") / "rates" / f"{_digest(about)}.json"


def work(plan: VideoPlan, stage: StagePlan, frames: int) -> float:
    """How many frames of 480p as many frames of this video are to a stage: by what it works on, the grid or what is shown."""
    probe = plan.probe
    if stage.stage.name == "frames":
        return frames * probe.width * probe.height / DISPLAYED
    return kept_work(plan, stage, frames)


def kept_work(plan: VideoPlan, stage: StagePlan, frames: int) -> float:
    """How many frames of 480p as many frames are to a stage by the bytes that it keeps: ``frames`` looks at what is shown, and keeps the grid."""
    probe = plan.probe
    if stage.stage.memory.shown or stage.stage.output:
        return frames * probe.width * probe.height / DISPLAYED
    height, width = working_size(probe, plan.stages["frames"].given.frames.width)
    return frames * height * width / GRID


def name_of(stage: StagePlan) -> str:
    """Of a stage with the settings that act on it."""
    return _front(stage.stage.name, stage.stage.version) + _digest(stage.acting)


def _front(name: str, version: int) -> str:
    return f"{name} {version} "


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def _sum(found: Iterable[Taken]) -> Taken:
    out = Taken()
    for taken in found:
        out.add(taken)
    return out


def _numbers(value: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of 0 or more by name."""
    found = {name: float(number) for name, number in value.items()}
    if not all(0 <= number < float("inf") for number in found.values()):
        raise ValueError("no sums")
    return found
