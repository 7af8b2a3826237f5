"""Runs for tests, and what they left."""

from __future__ import annotations

import zipfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from zsmoseg.settings import resolve
from zsmoseg.stores.archive import RECORD
from zsmoseg.stores.records import ARCHIVE
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.jobs import Outcome
from zsmoseg.workflows.running.request import Quiet, Report, Request
from zsmoseg.workflows.running.run import run


class Counter(Quiet):
    """Which parts were computed."""

    def __init__(self) -> None:
        self.parts: list[tuple[str, int]] = []
        self.videos: list[str] = []
        self.plans: list[VideoPlan] = []

    def planned(self, plan: VideoPlan) -> None:
        self.plans.append(plan)

    def part(self, plan: VideoPlan, stage: str, part: int, outcome: Outcome) -> None:
        assert outcome.state == "done", outcome
        self.parts.append((stage, part))
        self.videos.append(plan.name)

    @property
    def stages(self) -> set[str]:
        return {stage for stage, _ in self.parts}


def segment(
    sources: Path | list[Path], root: Path, settings: dict[str, Any] | None = None, **more: Any
) -> tuple[Report, Counter]:
    """Run in ``root``; serial and in small chunks unless asked otherwise."""
    given = sources if isinstance(sources, list) else [sources]
    chosen = resolve(overrides={"chunk.length": 4, **(settings or {})})
    counter = Counter()
    more.setdefault("scheduler", "serial")
    out = more.pop("out", root / "out")
    request = Request([str(s) for s in given], out, root / "store", chosen, **more)
    return run(request, counter), counter


def masks(out: Path, kind: str = "masks") -> np.ndarray:
    """The images of an output folder."""
    return np.stack([np.asarray(Image.open(p)) for p in sorted((out / kind).glob("*.png"))])


def data_bytes(root: Path) -> dict[str, bytes]:
    """Content of every array, table and image below ``root``, without records of time and place."""
    found = sorted(p for p in root.rglob("*") if p.is_file())
    kept = [p for p in found if p.name == "zarr.json" or p.suffix not in (".json", ".csv", ".mp4")]
    plain = {str(p.relative_to(root)): p.read_bytes() for p in kept if p.suffix != ARCHIVE}
    return plain | {
        f"{path.relative_to(root)}/{name}": content
        for path in kept
        if path.suffix == ARCHIVE
        for name, content in members(path).items()
    }


def members(path: Path) -> dict[str, bytes]:
    """Of an artifact that is one file, all but its record."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name != RECORD}
