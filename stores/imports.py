"""What was brought for a video: ``zsmoseg import`` notes it in ``VIDEO/imports.json``, later runs take it from there.

In a key the fingerprint of the files stands for their path. Runs note which kinds they found there: a record that was
lost is missed.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import asdict, dataclass, field, replace
from pathlib import PurePath

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.checks import Damage
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import read_record, write_record
from zsmoseg.stores.runs import Entry, last_entry

RECORD = "imports.json"
_AGAIN = "zsmoseg import again what you had imported"


@dataclass(frozen=True)
class Brought:
    """One cue that was brought for a video; ``key``: of the artifact that it became, if that is known."""

    path: str
    fingerprint: str
    kind: str = ""
    key: str = ""


@dataclass(frozen=True)
class Imports:
    """What was imported for a video, by kind; ``lost``: kinds of which that is not known any more, and why."""

    held: Mapping[str, Brought] = field(default_factory=dict)
    lost: Mapping[str, str] = field(default_factory=dict)

    @property
    def kinds(self) -> Set[str]:
        """All that were imported."""
        return {*self.held, *self.lost}


def imports_path(store: Store, video: str) -> PurePath:
    """Where the record of what was imported for a video is."""
    return files.below(store.video(video).path, RECORD)


def brought_before(store: Store, video: str) -> dict[str, Brought]:
    """What ``zsmoseg import`` brought for a video of the store, by kind.

    Raises
    ------
    StoreError
        The record of it is damaged, or cannot be read: without it other cues would be used.
    """
    path = imports_path(store, video)
    found = read_record(path)
    if (found is None and files.exists(path)) or not all(map(_is_brought, (found or {}).values())):
        closed = files.closed(path)
        what = (
            f"cannot be read ({closed}); mend that" if closed else f"is damaged; {_AGAIN}, or remove the file"
        )
        raise StoreError(f"{path}: {what}")
    return {name: Brought(**entry) for name, entry in (found or {}).items()}


def _is_brought(entry: object) -> bool:
    """Whether it is what ``remember`` notes of a cue."""
    return (
        isinstance(entry, dict)
        and {"path", "fingerprint"} <= entry.keys() <= set(Brought.__dataclass_fields__)
        and all(isinstance(v, str) for v in entry.values())
    )


def imports(store: Store, video: str, last: Entry | None, anew: bool = False) -> Imports:
    """What was imported for a video, and what of that is lost.

    Parameters
    ----------
    last
        What the last run did with the video.
    anew
        For an import: a damaged record gives way.

    Raises
    ------
    StoreError
        See ``brought_before``.
    """
    held = _whole(store, video) if anew else brought_before(store, video)
    missed = [kind for kind in (last.imported.split() if last else []) if kind not in held]
    path = imports_path(store, video)
    what = "does not name" if files.exists(path) else "is gone: it named"
    run = last.run if last else ""
    return Imports(held, {kind: f"{path}: {what} the {kind} imported before run {run}" for kind in missed})


def _whole(store: Store, video: str) -> dict[str, Brought]:
    """As ``brought_before``; nothing where the record is damaged."""
    try:
        return brought_before(store, video)
    except StoreError:
        if files.closed(imports_path(store, video)):
            raise
        return {}


def imports_damages(store: Store, video: str) -> list[Damage]:
    """What is wrong with the record of what was imported for a video."""
    path = imports_path(store, video)
    try:
        lost = imports(store, video, last_entry(store, video)).lost
    except StoreError as error:
        return [Damage(path, None, str(error).removeprefix(f"{path}: "))]
    return [Damage(path, None, f"{why.removeprefix(f'{path}: ')}; {_AGAIN}") for why in lost.values()]


def remember(
    store: Store, video: str, brought: Mapping[str, Brought], keys: Mapping[str, str] | None = None
) -> None:
    """Note what was brought, with the ``keys`` of its artifacts; what was brought before of the same kind gives way, and
    so does a damaged record.
    """
    keyed = {kind: replace(found, key=(keys or {}).get(kind, found.key)) for kind, found in brought.items()}
    known = {**_whole(store, video), **keyed}
    write_record(imports_path(store, video), {name: asdict(entry) for name, entry in known.items()})
