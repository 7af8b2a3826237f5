"""What was brought for a video: ``zsmoseg import`` notes it in ``VIDEO/imports.json``, later runs take it from there.

In a key the fingerprint of the files stands for their path.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import read_record, write_record

RECORD = "imports.json"


@dataclass(frozen=True)
class Brought:
    """One cue that was brought for a video."""

    path: str
    fingerprint: str
    kind: str = ""


def brought_before(store: Store, video: str) -> dict[str, Brought]:
    """What ``zsmoseg import`` brought for a video of the store, by kind.

    Raises
    ------
    StoreError
        The record of it is damaged: without it other cues would be used.
    """
    path = files.below(store.video(video).path, RECORD)
    found = read_record(path)
    if (found is None and files.exists(path)) or not all(map(_is_brought, (found or {}).values())):
        raise StoreError(
            f"{path}: is damaged; zsmoseg import again what you had imported, or remove the file"
        )
    return {name: Brought(**entry) for name, entry in (found or {}).items()}


def _is_brought(entry: object) -> bool:
    """Whether it is what ``remember`` notes of a cue."""
    names = set(Brought.__dataclass_fields__)
    return (
        isinstance(entry, dict) and entry.keys() == names and all(isinstance(v, str) for v in entry.values())
    )


def remember(store: Store, video: str, brought: Mapping[str, Brought]) -> None:
    """Note what was brought; what was brought before of the same kind gives way."""
    known = {**brought_before(store, video), **brought}
    write_record(
        files.below(store.video(video).path, RECORD), {name: asdict(entry) for name, entry in known.items()}
    )


def fingerprint(store: Store, path: Path) -> str:
    """Hash of names and content of a file or folder; known again while no file was touched."""
    found = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    stats = [(str(p), s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino) for p in found for s in [p.stat()]]

    def compute() -> str:
        whole = hashlib.sha256()
        for file in found:
            with file.open("rb") as stream:
                whole.update(
                    f"{file.relative_to(path.parent)} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode()
                )
        return whole.hexdigest()[:20]

    return store.fingerprint_of(f"import {stats}", compute)
