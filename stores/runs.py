"""The records of runs: what was asked for, which keys it reached, how it ended. Standard library only."""

from __future__ import annotations

import platform
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import PurePath
from typing import Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.video.plain_names import stays

PACKAGES = ("zsmoseg", "numpy", "scipy", "zarr", "numcodecs", "numba", "opencv-python-headless", "av")
"""What a run notes the version of."""


@dataclass
class RunRecord:
    """The record of one run: ``runs/<UTC time>-<id>.json``."""

    path: PurePath
    content: dict[str, Any]

    @classmethod
    def begin(cls, store: Store, settings: Mapping[str, Any], videos: Mapping[str, Any]) -> RunRecord:
        """Note what is about to run.

        Parameters
        ----------
        settings
            All settings by dotted name.
        videos
            By name: ``video`` (its id), ``keys`` (stage to key) and what else is worth remembering.
        """
        now = datetime.now(UTC)
        name = f"{now:%Y%m%dT%H%M%S.%fZ}-{uuid.uuid4().hex[:6]}"
        content = {
            "id": name,
            "begun": now.isoformat(timespec="seconds"),
            "settings": dict(settings),
            "videos": dict(videos),
            "versions": versions(),
            "outcome": "running",
        }
        record = cls(run_path(store, name), content)
        write_record(record.path, content)
        return record

    def end(self, outcome: str, failures: Mapping[str, str], traces: Mapping[str, str]) -> None:
        """Note how it ended; ``traces`` of what nobody expected."""
        ended = datetime.now(UTC).isoformat(timespec="seconds")
        self.content |= {"outcome": outcome, "failures": dict(failures), "ended": ended}
        if traces:
            self.content["traces"] = dict(traces)
        write_record(self.path, self.content)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results come from, as far as they are installed."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def run_path(store: Store, run: str) -> PurePath:
    """Where the record of a run is."""
    return files.below(store.runs, f"{run}.json", one=True)


def run_ids(store: Store) -> list[str]:
    """The ids of all runs, the latest last; those with a damaged record too."""
    return [path.stem for path in files.matching(store.runs, "*.json")]


def read_run(store: Store, run: str) -> dict[str, Any] | None:
    """The record of a run; None where it is missing, damaged, or names what does not lie in the store."""
    record = read_record(run_path(store, run))
    if not record or record.get("id") != run or not isinstance(record.get("videos"), dict):
        return None
    return record if all(_is_video(*entry) for entry in record["videos"].items()) else None


def _is_video(name: str, video: object) -> bool:
    """Whether it is what a run notes of a video."""
    if not isinstance(video, dict) or not isinstance(video.get("keys"), dict):
        return False
    told = [name, video.get("video"), *video["keys"], *video["keys"].values()]
    return all(stays(part) and "/" not in part for part in told) and isinstance(video.get("out", ""), str)


def outputs(store: Store) -> dict[str, str]:
    """The output folders that runs remember, and the id of the video that each was written for last."""
    return {
        video["out"]: video["video"]
        for run in list_runs(store)
        for video in run["videos"].values()
        if video.get("out")
    }


def list_runs(store: Store) -> list[dict[str, Any]]:
    """The records of all runs, the latest last; damaged ones are left out."""
    return [record for run in run_ids(store) if (record := read_run(store, run))]


def forget_run(store: Store, run: str) -> None:
    """Drop a run; what it alone reached is garbage then.

    Raises
    ------
    StoreError
        If there is no such run.
    """
    if run not in run_ids(store):
        raise StoreError(f"{store.path}: no run {run}; see zsmoseg runs")
    files.unlink(run_path(store, run))
