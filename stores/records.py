"""Small JSON files that appear whole or not at all, and the records of runs."""

from __future__ import annotations

import json
import os
import platform
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from zsmoseg.stores.location import Store


def read_json(path: Path) -> dict[str, Any] | None:
    """The object in ``path``; None where it is missing, empty, cut off or no object."""
    try:
        value = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None


def write_json(path: Path, value: Mapping[str, Any], sync: bool = False) -> None:
    """Write ``value`` beside ``path`` and move it there; ``sync``: on the disk before the name appears."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        with partial.open("w") as file:
            json.dump(value, file, sort_keys=True, allow_nan=False)
            file.write("\n")
            if sync:
                file.flush()
                os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@dataclass
class RunRecord:
    """The record of one run: ``runs/<time>-<id>.json``."""

    path: Path
    content: dict[str, Any]

    @classmethod
    def begin(cls, store: Store, settings: Mapping[str, Any], videos: Mapping[str, Any]) -> RunRecord:
        """Note what is about to run."""
        from importlib.metadata import version

        now = datetime.now(UTC)
        name = f"{now:%Y%m%dT%H%M%S.%fZ}-{uuid.uuid4().hex[:6]}"
        packages = ("zsmoseg", "numpy", "scipy", "zarr", "numba", "opencv-python-headless", "av")
        content = {
            "id": name,
            "begun": now.isoformat(timespec="seconds"),
            "settings": dict(settings),
            "videos": dict(videos),
            "versions": {"python": platform.python_version(), **{p: version(p) for p in packages}},
            "outcome": "running",
        }
        record = cls(store.path / "runs" / f"{name}.json", content)
        write_json(record.path, content)
        return record

    def end(self, outcome: str, failures: Mapping[str, str]) -> None:
        """Note how it ended."""
        ended = datetime.now(UTC).isoformat(timespec="seconds")
        self.content |= {"outcome": outcome, "failures": dict(failures), "ended": ended}
        write_json(self.path, self.content)


def list_runs(store: Store) -> list[dict[str, Any]]:
    """The records of all runs, the latest last; damaged ones are left out."""
    found = (read_json(path) for path in sorted((store.path / "runs").glob("*.json")))
    return [record for record in found if record and "videos" in record and "id" in record]
