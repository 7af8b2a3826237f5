"""Upkeep: what no run reaches, and whether every file is as it was written."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from zsmoseg.errors import StoreError
from zsmoseg.stores.artifact import Damage
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import list_runs

STALE = 3600.0
"""Seconds after which an unfinished file of a dead process is a leftover."""


@dataclass(frozen=True)
class Garbage:
    """What ``gc`` would remove."""

    paths: list[Path]
    size: int


def garbage(store: Store, forget: Sequence[str] = ()) -> Garbage:
    """Artifacts that no run reaches once the runs ``forget`` are dropped, and leftovers.

    Raises
    ------
    StoreError
        If there is no such run.
    """
    runs = list_runs(store)
    unknown = set(forget) - {run["id"] for run in runs}
    if unknown:
        raise StoreError(f"{store.path}: no run {', '.join(sorted(unknown))}; see zsmoseg runs")
    reached = {
        (video["video"], stage, key)
        for run in runs
        if run["id"] not in forget
        for video in run["videos"].values()
        for stage, key in video["keys"].items()
    }
    paths = [a.path for a in store.artifacts() if a.path.parts[-3:] not in reached]
    inside = tuple(str(p) + "/" for p in paths)
    old = time.time() - STALE
    for pattern in ("*.partial", "*.tmp"):
        paths += [
            p
            for p in sorted(store.path.rglob(pattern))
            if p.is_file() and p.stat().st_mtime < old and not str(p).startswith(inside or "\0")
        ]
    return Garbage(paths, sum(_size(p) for p in paths))


def remove_garbage(store: Store, found: Garbage, forget: Sequence[str] = ()) -> None:
    """Drop the runs ``forget``, then remove ``found``."""
    for run in forget:
        (store.path / "runs" / f"{run}.json").unlink(missing_ok=True)
    for path in found.paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def verify(store: Store) -> list[Damage]:
    """Every file of every artifact that is missing, of another size or of other content."""
    return [damage for artifact in store.artifacts() for damage in artifact.check()]


def _size(path: Path) -> int:
    if path.is_file():
        return path.stat().st_size
    return sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
