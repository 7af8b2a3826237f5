"""The records of runs: what was asked for, what each video reached, how it ended. Standard library only.

    STORE/runs/RUN.json               settings, versions, names of the videos, outcome; failures of videos without a folder
    STORE/VIDEO/runs/RUN-NAME.json    one video of the run: source, output folder, keys, outcome; NAME is a digest

A run writes one small record a video, so a batch of any size costs as much a video as a single one.
"""

from __future__ import annotations

import platform
import uuid
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import PurePath
from typing import Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import FINGERPRINT, RUNS, read_record, write_record
from zsmoseg.video.plain_names import stays

PACKAGES = ("zsmoseg", "numpy", "scipy", "zarr", "numcodecs", "numba", "opencv-python-headless", "av")
"""What a run notes the version of."""
DONE, FAILED, RUNNING, INTERRUPTED = "done", "failed", "running", "interrupted"
"""How a run, or a video of it, stands: it stays at ``running`` where the run was killed."""


@dataclass(frozen=True)
class Entry:
    """What a run did with one video.

    Attributes
    ----------
    run, name, video
        The ids of run and video, the name that the video had; no ``video`` where it did not come so far.
    source, out, graph, keys
        What was read; the output folder, empty where nothing is written there; stage to key.
    outcome, failure, trace
        How it stands, why it failed, and where, if nobody expected that.
    seen
        How its artifacts were when it was done (``stores/seen.py``).
    dropped
        Stages, by blanks, whose artifacts it does without since: nobody misses them until something reads them.
    imported
        Kinds of cues, by blanks, that ``imports.json`` names.
    """

    run: str
    name: str
    video: str = ""
    source: str = ""
    out: str = ""
    graph: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)
    outcome: str = RUNNING
    failure: str = ""
    trace: str = ""
    seen: Mapping[str, str] = field(default_factory=dict)
    dropped: str = ""
    imported: str = ""

    @property
    def gone(self) -> set[tuple[str, str]]:
        """What it does without: stages, each with its key."""
        return {(stage, self.keys[stage]) for stage in self.dropped.split() if stage in self.keys}


@dataclass
class RunRecord:
    """The record of one run: ``runs/<UTC time>-<id>.json``."""

    store: Store
    content: dict[str, Any]

    @classmethod
    def begin(
        cls,
        store: Store,
        settings: Mapping[str, Any],
        names: Sequence[str],
        sources: Sequence[str] = (),
        out: str = "",
    ) -> RunRecord:
        """Note what is about to run: all settings by dotted name, the names and ``sources`` of all videos, where the
        output folders are.
        """
        now = datetime.now(UTC)
        content = {
            "id": f"{now:%Y%m%dT%H%M%S.%fZ}-{uuid.uuid4().hex[:6]}",
            "begun": now.isoformat(timespec="seconds"),
            "settings": dict(settings),
            "names": list(names),
            "sources": list(sources),
            "out": out,
            "versions": versions(),
            "outcome": RUNNING,
        }
        record = cls(store, content)
        write_record(record.path, content)
        return record

    @property
    def id(self) -> str:
        """Its name in the store."""
        return str(self.content["id"])

    @property
    def path(self) -> PurePath:
        """Where it is."""
        return run_path(self.store, self.id)

    def note(self, entry: Entry) -> None:
        """Note how a video stands."""
        write_entry(self.store, entry)

    def end(self, outcome: str, failures: Mapping[str, str], traces: Mapping[str, str]) -> None:
        """Note how the run ended; ``failures``, ``traces``: of videos that have no record of their own."""
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


# ---------------------------------------------------------------------- runs
def run_path(store: Store, run: str) -> PurePath:
    """Where the record of a run is."""
    return files.below(store.runs, f"{run}.json", one=True)


def run_ids(store: Store) -> list[str]:
    """The ids of all runs, the latest last; those with a damaged record too."""
    return [path.stem for path in files.matching(store.runs, "*.json")]


def begun_before(store: Store, when: datetime) -> list[str]:
    """The runs that were begun before: their ids begin with the time, in UTC."""
    border = f"{when:%Y%m%dT%H%M%S.%fZ}"
    return [run for run in run_ids(store) if run < border]


def read_run(store: Store, run: str) -> dict[str, Any] | None:
    """The record of a run; None where it is missing, damaged or another's."""
    record = read_record(run_path(store, run)) or {}
    names, failures = record.get("names"), record.setdefault("failures", {})
    if record.get("id") != run or not isinstance(names, list) or not isinstance(failures, dict):
        return None
    sources, out = record.setdefault("sources", []), record.setdefault("out", "")
    if not isinstance(sources, list):
        return None
    told = [record.get("outcome"), out, *names, *sources, *failures.values()]
    return record if all(isinstance(text, str) for text in told) else None


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
    paths = [path for path in entry_paths(store) if run_of(path) == run]
    if not paths and run not in run_ids(store):
        raise StoreError(f"{store.path}: no run {run}; see zsmoseg runs")
    for path in [*paths, run_path(store, run)]:
        files.unlink(path)


# ---------------------------------------------------------------------- videos of runs
def _entry_path(store: Store, entry: Entry) -> PurePath:
    return files.below(store.video(entry.video).path, f"{RUNS}/{entry.run}-{_digest(entry.name)}.json")


def write_entry(store: Store, entry: Entry) -> None:
    """Write the record of a video in a run, over that which is there."""
    write_record(_entry_path(store, entry), vars(entry))


def _digest(name: str) -> str:
    return f"{zlib.crc32(name.encode(errors='surrogateescape')):08x}"


def entry_paths(store: Store, name: str | None = None, video: str | None = None) -> Iterator[PurePath]:
    """Where the records of videos, of those of one name, or of one video are: video by video, the latest last."""
    end = "*" if name is None else f"*-{_digest(name)}"
    for one in store.videos() if video is None else [video]:
        yield from files.matching(files.below(store.video(one).path, RUNS), f"{end}.json")


def run_of(path: PurePath) -> str:
    """The run whose record of a video this is."""
    return path.stem.rpartition("-")[0]


def read_entry(path: PurePath) -> Entry | None:
    """The record of a video in a run; None where it is damaged, another's, or names what does not lie in the store.

    The folder counts for the id of the video: people may call it otherwise.
    """
    record, folder = read_record(path) or {}, path.parent.parent.name
    keys, seen = record.get("keys"), record.get("seen", {})
    if not isinstance(keys, dict) or not isinstance(seen, dict):
        return None
    told = {name: record.get(name, "") for name in Entry.__dataclass_fields__ if name not in ("keys", "seen")}
    entry = Entry(**told, keys=keys, seen=seen)
    if not all(isinstance(text, str) for text in [*told.values(), *keys.values(), *seen.values()]):
        return None
    ours = (
        path.stem == f"{entry.run}-{_digest(entry.name)}"
        and entry.video[-FINGERPRINT:] == folder[-FINGERPRINT:]
    )
    plain = all(stays(part) and "/" not in part for part in [entry.name, *keys, *keys.values()])
    return replace(entry, video=folder) if ours and plain else None


def last_entry(store: Store, video: str) -> Entry | None:
    """What the latest run did with the content of a video, under whatever name; None where nothing can be read."""
    paths = files.matching(files.below(store.video(video).path, RUNS), "*.json")
    return read_entry(paths[-1]) if paths else None


def entries(store: Store, name: str | None = None) -> list[Entry]:
    """What runs did with all videos, or with those of one name, the latest last; damaged records are left out."""
    found = (entry for path in entry_paths(store, name) if (entry := read_entry(path)))
    return sorted((entry for entry in found if name in (None, entry.name)), key=lambda entry: entry.run)


def latest(store: Store, wanted: Callable[[Entry], bool] = lambda entry: True) -> dict[str, Entry]:
    """What the latest run that meant a video did with it, by name, as far as that is ``wanted``.

    A video that failed before it had a folder, or that an interrupted run did not come to, has no ``video`` and no keys.
    """
    found: dict[str, Entry] = {}
    for run in list_runs(store):
        sources = dict(zip(run["names"], run["sources"], strict=False))
        begun = run["outcome"] if run["outcome"] in (RUNNING, INTERRUPTED) else INTERRUPTED
        for name in [*run["names"], *run["failures"]]:
            failure = run["failures"].get(name, "")
            out = str(files.folder(run["out"]) / name) if run["out"] else ""
            entry = Entry(run["id"], name, "", sources.get(name, ""), out)
            if wanted(entry):
                found[name] = replace(entry, outcome=FAILED if failure else begun, failure=failure)
    for entry in _last_entries(store, wanted):
        if entry.name not in found or entry.run >= found[entry.name].run:
            found[entry.name] = entry
    return found


def _last_entries(store: Store, wanted: Callable[[Entry], bool]) -> Iterator[Entry]:
    """The latest record of each name in each folder that is ``wanted``; of many runs only this one is read, if it is."""
    last: dict[tuple[PurePath, str], list[PurePath]] = {}
    for path in entry_paths(store):
        last.setdefault((path.parent, path.stem.rpartition("-")[2]), []).append(path)
    for paths in last.values():
        read = filter(None, map(read_entry, reversed(paths)))
        entry = next(filter(wanted, read), None)
        if entry is not None:
            yield entry


def outputs(store: Store) -> dict[str, str]:
    """The output folders that runs remember, and the id of the video that each was written for last."""
    return {entry.out: entry.video for entry in entries(store) if entry.out}
