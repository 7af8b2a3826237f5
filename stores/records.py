"""Small JSON files that appear whole or not at all, and the records of runs. Standard library only.

A *record* carries a checksum of its content: cut off, emptied or changed by a flipped bit, it reads as None.
"""

from __future__ import annotations

import json
import platform
import uuid
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import files

if TYPE_CHECKING:
    from zsmoseg.stores.location import Store

PACKAGES = ("zsmoseg", "numpy", "scipy", "zarr", "numcodecs", "numba", "opencv-python-headless", "av")
"""What a run notes the version of."""


def read_json(path: Path) -> dict[str, Any] | None:
    """The object in ``path``; None where it is missing, empty, cut off or no object."""
    try:
        value = json.loads(files.read(path) or b"")
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def write_json(path: Path, value: Mapping[str, Any], sync: bool = False) -> None:
    """Write ``value`` beside ``path`` and move it there; ``sync``: on the disk before the name appears.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    files.write_whole(path, _text(value).encode() + b"\n", sync)


def read_record(path: Path) -> dict[str, Any] | None:
    """What ``write_record`` wrote; None where the file is missing or differs from that in anything."""
    value = read_json(path)
    if value is None:
        return None
    noted = value.pop("checksum", None)
    return value if noted == checksum(value) else None


def write_record(path: Path, value: Mapping[str, Any], sync: bool = False) -> None:
    """Write ``value`` with a checksum, atomically; numpy numbers and arrays become plain ones.

    Raises
    ------
    SpaceError
        If the disk is full.
    ValueError
        If ``value`` holds NaN or infinity.
    """
    content = as_json(value)
    write_json(path, {**content, "checksum": checksum(content)}, sync)


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """``value`` as it will be read back: lists for tuples and arrays, text for keys."""
    plain = json.loads(_text(value))
    assert isinstance(plain, dict)
    return plain


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot stand in a record")


def checksum(content: Mapping[str, Any]) -> str:
    """8 hexadecimal digits of CRC-32 over canonical JSON."""
    return f"{zlib.crc32(_text(content).encode()):08x}"


def recall_record(path: Path) -> dict[str, Any] | None:
    """As ``read_record``, parsed once while the file stays the same; not to be changed by who gets it."""
    signature = files.signature(path)
    return _parsed(path, signature) if signature else None


@lru_cache(maxsize=64)
def _parsed(path: Path, signature: tuple[int, int, int]) -> dict[str, Any] | None:
    return read_record(path)


# ---------------------------------------------------------------------- runs
@dataclass
class RunRecord:
    """The record of one run: ``runs/<UTC time>-<id>.json``."""

    path: Path
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


def run_path(store: Store, run: str) -> Path:
    """Where the record of a run is."""
    return store.runs / f"{run}.json"


def run_ids(store: Store) -> list[str]:
    """The ids of all runs, the latest last; those with a damaged record too."""
    return sorted(path.stem for path in store.runs.glob("*.json"))


def read_run(store: Store, run: str) -> dict[str, Any] | None:
    """The record of a run; None where it is missing or damaged."""
    record = read_record(run_path(store, run))
    return record if record and "videos" in record and "id" in record else None


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
    files.remove(run_path(store, run))
