"""Upkeep: what no run reaches, and whether every file is as it was written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.checks import Damage, check
from zsmoseg.stores.location import MARK, Store
from zsmoseg.stores.output import known_outputs
from zsmoseg.stores.records import ARCHIVE, DESCRIPTION, read_json, read_record
from zsmoseg.stores.runs import entry_paths, forget_run, read_entry, read_run, run_ids, run_of, run_path


@dataclass(frozen=True)
class Garbage:
    """What ``remove_garbage`` would remove: folders and files, and their bytes."""

    paths: list[PurePath]
    size: int


def garbage(store: Store, forget: Sequence[str] = ()) -> Garbage:
    """What no run reaches once the runs ``forget`` are dropped, and leftovers of killed processes.

    Videos, artifacts, probes, fingerprints of videos that are gone, and unfinished files older than an hour.

    Raises
    ------
    StoreError
        If there is no such run, or the record of a run that stays is damaged: nobody knows what it reaches.
    """
    reached = _reached(store, forget)
    folders = list(_unreached(store, reached))
    left = {video[-16:] for video in store.videos() if store.path / video not in folders}
    stale = [
        path
        for path in files.matching(files.below(store.path, "fingerprints"), "*.json")
        if str((read_record(path) or {}).get("fingerprint"))[:16] not in left
    ]
    gone = set(folders)
    unfinished = [path for path in files.leftovers(store.path) if gone.isdisjoint(path.parents)]
    paths = [*folders, *stale, *unfinished]
    return Garbage(paths, sum(files.size(path) or 0 for path in paths))


def _reached(store: Store, forget: Sequence[str]) -> set[tuple[str, ...]]:
    """(video,) and (video, stage, key) of all that the runs which stay reach."""
    paths = list(entry_paths(store))
    unknown = set(forget) - {*run_ids(store), *map(run_of, paths)}
    if unknown:
        raise StoreError(f"{store.path}: no run {', '.join(sorted(unknown))}; see zsmoseg runs")
    reached: set[tuple[str, ...]] = set()
    for path in paths:
        if run_of(path) in forget:
            continue
        entry = read_entry(path)
        if entry is None:
            raise StoreError(
                f"{path}: is damaged; what it reaches is not known, so nothing is removed; "
                f"drop it with zsmoseg gc --forget {run_of(path)}"
            )
        reached.add((entry.video,))
        reached |= {(entry.video, stage, key) for stage, key in entry.keys.items()}
    return reached


def _unreached(store: Store, reached: set[tuple[str, ...]]) -> Iterator[PurePath]:
    for video in store.videos():
        if (video,) not in reached:
            yield store.path / video
            continue
        for artifact in store.video(video).artifacts():
            if artifact.path.relative_to(store.path).parts not in reached:
                yield artifact.archive if artifact.packed else artifact.path
        for path in store.video(video).probes():
            if (video, "frames", path.stem) not in reached:
                yield path


def remove_garbage(store: Store, found: Garbage, forget: Sequence[str] = ()) -> None:
    """Drop the runs ``forget``, then remove ``found``: a crash leaves garbage, never a run without data."""
    for run in forget:
        forget_run(store, run)
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
        for artifact in video.artifacts():
            found += check(artifact, deep)
    return found


def take_back(store: Store, deep: bool = True) -> list[Damage]:
    """As ``verify``; the next run redoes the parts that are damaged, and mends the rest by itself.

    Records of runs that cannot be read are dropped: what they alone reached is garbage from then on.
    """
    found = _verify(store, deep)
    for damage in found:
        place = damage.path.relative_to(store.path).parts
        if damage.path.suffix == ARCHIVE:
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
    return found
