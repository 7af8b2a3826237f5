"""Whether the files of an artifact are as its records say. Standard library only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.stores import files
from zsmoseg.stores.records import checksum, recall_record

if TYPE_CHECKING:
    from zsmoseg.stores.artifact import Artifact


@dataclass(frozen=True)
class Damage:
    """A file that is not as its record says; ``part`` where it belongs to one part of an artifact."""

    path: Path
    part: int | None
    what: str


def part_problem(artifact: Artifact, part: int) -> str | None:
    """See ``Artifact.part_problem``."""
    record = artifact.part(part)
    if record is None:
        missing = files.size(artifact.record_path(part)) is None
        return "not computed yet" if missing else "its record is damaged"
    if artifact.laid_out.get("parts", [])[part : part + 1] != [[record.start, record.stop]]:
        return "the video was cut in another way"
    wrong = wrong_sizes(artifact, part, record.files)
    return f"{wrong[0].path.relative_to(artifact.path)} {wrong[0].what}" if wrong else None


def wrong_sizes(artifact: Artifact, part: int, names: Iterable[str]) -> list[Damage]:
    """Which of the files ``names`` of a part have not the size that its record says."""
    record, found = artifact.part(part), []
    for name in names:
        expected = record.files[name]["size"] if record and name in record.files else None
        actual = files.size(artifact.path / name)
        if expected is None:
            found.append(Damage(artifact.path / name, part, "is in no record"))
        elif actual is None:
            found.append(Damage(artifact.path / name, part, "is missing"))
        elif actual != expected:
            found.append(Damage(artifact.path / name, part, f"has {actual} bytes instead of {expected}"))
    return found


def wrong_content(artifact: Artifact, part: int, names: Iterable[str]) -> list[Damage]:
    """Which of the files ``names`` of a part have another checksum than its record says."""
    record, found = artifact.part(part), []
    for name in names:
        content = files.read(artifact.path / name)
        if record is None or content is None or files.crc32(content) != record.files[name]["crc32"]:
            found.append(Damage(artifact.path / name, part, "has other content than was written"))
    return found


def check(artifact: Artifact, deep: bool) -> list[Damage]:
    """See ``Artifact.check``."""
    if not artifact.laid_out:
        return [Damage(artifact.path / "artifact.json", None, "is missing or damaged")]
    found = [
        Damage(path, None, "is missing" if files.size(path) is None else "is damaged")
        for path, text in artifact.metadata()
        if files.read(path) != text
    ]
    done = artifact.done
    if done is None and files.size(artifact.path / "done.json") is not None:
        found.append(Damage(artifact.path / "done.json", None, "is damaged"))
    for part in range(len(artifact.parts)):
        found += _check_part(artifact, part, done, deep)
    return found


def _check_part(artifact: Artifact, part: int, done: Mapping[str, Any] | None, deep: bool) -> list[Damage]:
    path = artifact.record_path(part)
    record = recall_record(path)
    if record is None:
        exists = files.size(path) is not None
        missing = [Damage(path, part, "is damaged" if exists else "is missing")]
        return missing if exists or done is not None else []
    if done is not None and done["records"][part : part + 1] != [checksum(record)]:
        return [Damage(path, part, "is another one than when the artifact was sealed")]
    wrong = wrong_sizes(artifact, part, record["files"])
    healthy = set(record["files"]) - {damage.path.relative_to(artifact.path).as_posix() for damage in wrong}
    return wrong + (wrong_content(artifact, part, sorted(healthy)) if deep else [])
