"""Whether the files of an artifact are as its records say. Standard library only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.records import checksum, recall_record
from zsmoseg.video.plain_names import stays

Expected = Mapping[str, Mapping[str, int]]
"""``size`` and ``crc32`` of files, by path relative to the artifact."""


@dataclass(frozen=True)
class Damage:
    """A file that is not as its record says; ``part`` where it belongs to one part of an artifact."""

    path: PurePath
    part: int | None
    what: str


def part_problem(artifact: Artifact, part: int) -> str | None:
    """Why a part is not usable, by its record and the sizes of its files; None where it is."""
    record = artifact.part(part)
    if record is None:
        missing = files.size(artifact.record_path(part)) is None
        return "not computed yet" if missing else "its record is damaged"
    if artifact.laid_out.get("parts", [])[part : part + 1] != [[record.start, record.stop]]:
        return "the video was cut in another way"
    wrong = wrong_sizes(artifact, part, record.files, record.files)
    return f"{wrong[0].path.relative_to(artifact.path)} {wrong[0].what}" if wrong else None


def joined_problem(artifact: Artifact) -> str | None:
    """Why the whole cannot be opened: not sealed, or a joined table is not there; None where it can."""
    done = artifact.done
    if done is None:
        return "not finished yet"
    wrong = wrong_sizes(artifact, None, done["files"], done["files"])
    return f"{wrong[0].path.relative_to(artifact.path)} {wrong[0].what}" if wrong else None


def wrong_sizes(
    artifact: Artifact, part: int | None, expected: Expected, names: Iterable[str]
) -> list[Damage]:
    """Which of the files ``names`` have not the size that is ``expected``."""
    found = []
    for name in names:
        if not stays(name):
            found.append(Damage(_record(artifact, part), part, f"names {name!r}, which is no file of it"))
            continue
        size = expected[name]["size"] if name in expected else None
        actual = files.size(artifact.path / name)
        if size is None:
            found.append(Damage(artifact.path / name, part, "is in no record"))
        elif actual is None:
            found.append(Damage(artifact.path / name, part, "is missing"))
        elif actual != size:
            found.append(Damage(artifact.path / name, part, f"has {actual} bytes instead of {size}"))
    return found


def _record(artifact: Artifact, part: int | None) -> PurePath:
    return artifact.records / "done.json" if part is None else artifact.record_path(part)


def wrong_content(
    artifact: Artifact, part: int | None, expected: Expected, names: Iterable[str]
) -> list[Damage]:
    """Which of the files ``names`` have another checksum than is ``expected``."""
    found = []
    for name in names:
        try:
            content = files.read(files.below(artifact.path, name))
        except StoreError:
            content = None
        if content is None or name not in expected or files.crc32(content) != expected[name]["crc32"]:
            found.append(Damage(artifact.path / name, part, "has other content than was written"))
    return found


def check(artifact: Artifact, deep: bool = False) -> list[Damage]:
    """What is damaged: by sizes, or by content too (``deep``). Parts not computed yet are no damage."""
    if not artifact.laid_out:
        return [Damage(artifact.records / "artifact.json", None, "is missing or damaged")]
    found = [
        Damage(path, None, "is missing" if files.size(path) is None else "is damaged")
        for path, text in artifact.metadata()
        if files.read(path) != text
    ]
    done = artifact.done
    if done is None and files.size(artifact.records / "done.json") is not None:
        found.append(Damage(artifact.records / "done.json", None, "is damaged"))
    for part in range(len(artifact.parts)):
        found += _check_part(artifact, part, done, deep)
    return found + (_check_files(artifact, None, done["files"], deep) if done else [])


def _check_part(artifact: Artifact, part: int, done: Mapping[str, Any] | None, deep: bool) -> list[Damage]:
    path = artifact.record_path(part)
    record = recall_record(path)
    if record is None:
        exists = files.size(path) is not None
        missing = [Damage(path, part, "is damaged" if exists else "is missing")]
        return missing if exists or done is not None else []
    if done is not None and done["records"][part : part + 1] != [checksum(record)]:
        return [Damage(path, part, "is another one than when the artifact was sealed")]
    return _check_files(artifact, part, record["files"], deep)


def _check_files(artifact: Artifact, part: int | None, expected: Expected, deep: bool) -> list[Damage]:
    wrong = wrong_sizes(artifact, part, expected, expected)
    healthy = set(filter(stays, expected))
    healthy -= {damage.path.relative_to(artifact.path).as_posix() for damage in wrong}
    return wrong + (wrong_content(artifact, part, expected, sorted(healthy)) if deep else [])
