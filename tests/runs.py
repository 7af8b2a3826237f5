"""Runs for tests, and what they left."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from zsmoseg.settings import resolve
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
    paths = sorted(p for p in root.rglob("*") if p.is_file())
    return without_records({str(path.relative_to(root)): path.read_bytes() for path in paths})


def without_records(contents: Mapping[str, bytes]) -> dict[str, bytes]:
    """Files by name, those of a zip one by one, but not what tells of time and place."""
    found: dict[str, bytes] = {}
    for name, content in contents.items():
        if name.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                found |= {f"{name}/{inside}": archive.read(inside) for inside in archive.namelist()}
        else:
            found[name] = content
    return {
        name: content
        for name, content in found.items()
        if name.endswith("/zarr.json") or not name.endswith((".json", ".csv", ".mp4"))
    }
