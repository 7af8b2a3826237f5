"""Upkeep: what no run reaches, and whether every file is as it was written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import PurePath

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.checks import Damage, check, last_record
from zsmoseg.stores.imports import brought_before, imports_damages, imports_path
from zsmoseg.stores.location import MARK, Store
from zsmoseg.stores.output import known_outputs
from zsmoseg.stores.records import ARCHIVE, DESCRIPTION, PROBES, read_json, read_record
from zsmoseg.stores.runs import (
    Entry,
    entry_paths,
    forget_run,
    read_entry,
    read_run,
    run_ids,
    run_of,
    run_path,
    write_entry,
)

Place = tuple[str, ...]
"""(video,) or (video, stage, key)."""


@dataclass(frozen=True)
class Garbage:
    """What ``remove_garbage`` would remove: folders and files, and their bytes."""

    paths: list[PurePath]
    size: int
    thinner: list[Entry] = field(default_factory=list)
    """Records of videos in runs that do with less from then on."""
    kept: list[PurePath] = field(default_factory=list)
    """Records of what was imported, which alone keep a video."""


@dataclass(frozen=True)
class Thin:
    """Runs that keep the artifacts of some stages only."""

    runs: Set[str]
    stages: Set[str]

    def of(self, entry: Entry) -> Entry:
        """The record of a video in a run as it will be."""
        if entry.run not in self.runs:
            return entry
        dropped = {*entry.dropped.split(), *(entry.keys.keys() - self.stages)}
        return replace(entry, dropped=" ".join(sorted(dropped)))


EVERYTHING = Thin(frozenset(), frozenset())


def garbage(
    store: Store,
    forget: Sequence[str] = (),
    keep: Set[Place] | None = None,
    thin: Thin = EVERYTHING,
    aged: Sequence[str] = (),
) -> Garbage:
    """What no run reaches once the runs ``forget`` and ``aged`` are dropped, and leftovers of killed processes.

    Videos, artifacts, probes, fingerprints of videos that are gone, and unfinished files older than an hour. What was
    imported for a video stays, unless every run of the video is in ``forget``: nobody can make it again.

    Parameters
    ----------
    forget, aged
        Named by the user; by their age alone.
    keep
        What is kept, instead of what runs reach; records of videos in runs that reach more go first.
    thin
        Runs that do with less.

    Raises
    ------
    StoreError
        If there is no such run, or the record of a run that stays is damaged: nobody knows what it reaches.
    """
    entries = _entries(store, [*forget, *aged])
    by_run = {path: _places(thin.of(entry)) for path, entry in entries.items()}
    reached = set().union(*by_run.values()) if keep is None else keep
    imported = _imported(store, forget)
    kept = [imports_path(store, *place) for place in sorted(imported - reached) if len(place) == 1]
    unreached = dict(_unreached(store, reached | imported))
    blind = [path for path, places in by_run.items() if not places.isdisjoint(unreached)]
    folders = list(unreached.values())
    left = {video[-16:] for video in store.videos() if store.path / video not in folders}
    stale = [
        path
        for path in files.matching(files.below(store.path, "fingerprints"), "*.json")
        if str((read_record(path) or {}).get("fingerprint"))[:16] not in left
    ]
    gone = set(folders)
    unfinished = [path for path in files.leftovers(store.path) if gone.isdisjoint(path.parents)]
    blind = [path for path in blind if gone.isdisjoint(path.parents)]
    paths = [*blind, *folders, *stale, *unfinished]
    thinner = [new for entry in entries.values() if (new := thin.of(entry)) != entry]
    return Garbage(paths, sum(files.size(path) or 0 for path in paths), thinner, kept)


def _imported(store: Store, forget: Sequence[str]) -> set[Place]:
    """What the records of imports reach, but of videos of which the user forgets every run."""
    found: set[Place] = set()
    for video in store.videos():
        if not files.exists(imports_path(store, video)):
            continue
        runs = {run_of(path) for path in entry_paths(store, video=video)}
        if runs and runs <= set(forget):
            continue
        cues = brought_before(store, video)
        found |= {(video,), *((video, kind, cue.key) for kind, cue in cues.items() if cue.key)}
    return found


def freed(store: Store) -> dict[str, int]:
    """Bytes of what each run alone reaches, the latest last: what forgetting it would free."""
    reached: dict[Place, set[str]] = {}
    for entry in _entries(store, ()).values():
        for place in _places(entry):
            reached.setdefault(place, set()).add(entry.run)
    found = dict.fromkeys(run_ids(store), 0)
    for place, path in _unreached(store, {place[:1] for place in reached if len(place) == 1}):
        runs = reached.get(place, set())
        if len(runs) == 1:
            (run,) = runs
            found[run] = found.get(run, 0) + (files.size(path) or 0)
    return found


def give_up(store: Store, entry: Entry) -> None:
    """Remove what a finished run does without, as far as no other one has it."""
    others = [found for path in entry_paths(store, video=entry.video) if (found := read_entry(path))]
    reached = set().union(*map(_places, others))
    for stage, key in entry.gone:
        artifact = store.artifact(entry.video, stage, key)
        if (entry.video, stage, key) not in reached:
            files.remove(artifact.archive if artifact.packed else artifact.path)


def _places(entry: Entry) -> set[Place]:
    """What the record of a video in a run reaches."""
    kept = set(entry.keys.items()) - entry.gone
    probe = {(entry.video, PROBES, entry.keys["frames"])} if "frames" in entry.keys else set()
    return {(entry.video,), *probe, *((entry.video, stage, key) for stage, key in kept)}


def _entries(store: Store, forget: Sequence[str]) -> dict[PurePath, Entry]:
    """The records of videos in the runs which stay, by their place."""
    paths = list(entry_paths(store))
    unknown = set(forget) - {*run_ids(store), *map(run_of, paths)}
    if unknown:
        raise StoreError(f"{store.path}: no run {', '.join(sorted(unknown))}; see zsmoseg runs")
    found = {}
    for path in paths:
        if run_of(path) in forget:
            continue
        entry = read_entry(path)
        if entry is None:
            what = f"cannot be read ({closed})" if (closed := files.closed(path)) else "is damaged"
            raise StoreError(
                f"{path}: {what}; what it reaches is not known, so nothing is removed; "
                f"drop it with zsmoseg gc --forget {run_of(path)}"
            )
        found[path] = entry
    return found


def _unreached(store: Store, reached: Set[Place]) -> Iterator[tuple[Place, PurePath]]:
    for video in store.videos():
        if (video,) not in reached:
            yield (video,), store.path / video
            continue
        for artifact in store.video(video).artifacts():
            place = artifact.path.relative_to(store.path).parts
            if place not in reached:
                yield place, artifact.archive if artifact.packed else artifact.path
        for path in store.video(video).probes():
            if reached.isdisjoint({(video, "frames", path.stem), (video, PROBES, path.stem)}):
                yield (video, PROBES, path.stem), path


def remove_garbage(store: Store, found: Garbage, forget: Sequence[str] = ()) -> None:
    """Drop the runs ``forget``, then remove ``found``: a crash leaves garbage, never a run without data."""
    for run in forget:
        forget_run(store, run)
    for entry in found.thinner:
        write_entry(store, entry)
    for path in found.paths:
        files.remove(path)


def verify(store: Store, deep: bool = True) -> list[Damage]:
    """Every file that is missing, of another size or, with ``deep``, of other content than was written.

    Those of the store, and those in the output folders of its runs. Nothing is changed.
    """
    found = _verify(store, deep)
    return found + [damage for _, damages in known_outputs(store) for damage in damages]


def _verify(store: Store, deep: bool) -> list[Damage]:
    found = []
    if not isinstance((read_json(store.path / MARK) or {}).get("format"), int):
        found.append(Damage(store.path / MARK, None, "is missing or damaged"))
    for run in run_ids(store):
        if read_run(store, run) is None:
            found.append(Damage(run_path(store, run), None, "is damaged"))
    found += [Damage(path, None, "is damaged") for path in entry_paths(store) if read_entry(path) is None]
    for video in map(store.video, store.videos()):
        if video.description is None:
            found.append(Damage(video.path / DESCRIPTION, None, "is missing or damaged"))
        for path in video.probes():
            if read_record(path) is None:
                found.append(Damage(path, None, "is damaged"))
        found += imports_damages(store, video.path.name)
        for artifact in video.artifacts():
            found += check(artifact, deep)
    gone = {damage.path: damage for _, lost in _lost(store) for damage in lost.values()}
    return [_told(damage) for damage in [*found, *gone.values()]]


def _told(damage: Damage) -> Damage:
    """What the system does not let us read may be as it was written."""
    closed = files.closed(damage.path)
    return replace(damage, what=f"cannot be read ({closed}); mend that", closed=True) if closed else damage


def _lost(store: Store) -> Iterator[tuple[Entry, dict[str, Damage]]]:
    """What a run had finished and nobody took back, by stage, and is gone without a trace: the whole, or its last record.

    No other file tells of it. The last record of a folder holds those of its parts, so that without it none is left.
    """
    for entry in filter(None, map(read_entry, entry_paths(store))):
        lost = {}
        for stage in (entry.seen.keys() & entry.keys) - set(entry.dropped.split()):
            artifact = store.artifact(entry.video, stage, entry.keys[stage])
            if not artifact.packed and not files.exists(artifact.path):
                lost[stage] = Damage(artifact.path, None, f"is gone; the run {entry.run} had finished it")
            elif artifact.laid_out and not artifact.written:
                lost[stage] = Damage(last_record(artifact), None, f"is gone; the run {entry.run} wrote it")
        if lost:
            yield entry, lost


def take_back(store: Store, deep: bool = True) -> list[Damage]:
    """As ``verify``; the next run redoes the parts that are damaged, and mends the rest by itself.

    Damaged records of runs are dropped: what they alone reached is garbage from then on. Nothing is done about files that
    the system does not let us read, and about records of imports: those only their user can make again.
    """
    found = _verify(store, deep)
    for damage in found:
        place = damage.path.relative_to(store.path).parts
        if damage.closed or files.is_folder(damage.path):
            continue  # it may be sound; it is somebody's
        if damage.path.suffix == ARCHIVE or place[1:2] == (PROBES,):
            files.unlink(damage.path)
        elif len(place) > 3:
            artifact = store.artifact(*place[:3])
            artifact.unseal()
            artifact.invalidate([] if damage.part is None else [damage.part])
        elif damage.path.parent.name == store.runs.name:
            files.unlink(damage.path)
    for output, damages in known_outputs(store):
        if output.listed and not output.foreign:
            output.forget([damage.path.relative_to(output.path).as_posix() for damage in damages])
        found += damages
    for entry, lost in list(_lost(store)):
        write_entry(store, replace(entry, seen={s: how for s, how in entry.seen.items() if s not in lost}))
    return found
