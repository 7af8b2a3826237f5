"""Whether the files of an artifact are as its records say. Standard library only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import PurePath

from zsmoseg.stores import archive, files
from zsmoseg.stores.artifact import ABOUT, DONE, Artifact, part_name
from zsmoseg.stores.records import RECORDS
from zsmoseg.video.plain_names import stays

Expected = Mapping[str, Mapping[str, int]]
"""``size`` and ``crc32`` of files, by path relative to the artifact."""


@dataclass(frozen=True)
class Damage:
    """A file that is not as its record says; ``part`` where it belongs to one part of an artifact; ``closed``: it may be as
    it was, the system does not let us read it.
    """

    path: PurePath
    part: int | None
    what: str
    closed: bool = False


def part_problem(artifact: Artifact, part: int) -> str | None:
    """Why a part is not usable, by its record and the sizes of its files; None where it is."""
    record = artifact.part(part)
    if record is None:
        # written meanwhile by a run with longer chunks, to which all frames were one part
        if part and artifact.packed and len(artifact.parts) == 1:
            return part_problem(artifact, 0)
        there = artifact.packed or artifact.inside.has(part_name(part))
        return "its record is damaged" if there else "not computed yet"
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
    found, inside = [], artifact.inside
    for name in names:
        if not stays(name):
            what = f"names {name!r}, which is no file of it"
            found.append(Damage(_record(artifact, DONE if part is None else part_name(part)), part, what))
            continue
        size = expected[name]["size"] if name in expected else None
        actual = inside.size(name)
        if size is None:
            found.append(Damage(artifact.path / name, part, "is in no record"))
        elif actual is None:
            found.append(Damage(artifact.path / name, part, "is missing"))
        elif actual != size:
            found.append(Damage(artifact.path / name, part, f"has {actual} bytes instead of {size}"))
    return found


def last_record(artifact: Artifact) -> PurePath:
    """Where the record is that says that the whole is done."""
    return _record(artifact, DONE)


def _record(artifact: Artifact, name: str) -> PurePath:
    return artifact.path / RECORDS / f"{name}.json"


def wrong_content(
    artifact: Artifact, part: int | None, expected: Expected, names: Iterable[str]
) -> list[Damage]:
    """Which of the files ``names`` have another checksum than is ``expected``."""
    found, inside = [], artifact.inside
    for name in names:
        content = inside.read(name)
        if content is None or name not in expected or files.crc32(content) != expected[name]["crc32"]:
            found.append(Damage(artifact.path / name, part, "has other content than was written"))
    return found


def check(artifact: Artifact, deep: bool = False) -> list[Damage]:
    """What is damaged: by sizes, or by content too (``deep``). Parts not computed yet are no damage."""
    return _check_archive(artifact, deep) if artifact.packed else _check_folder(artifact, deep)


def _check_archive(artifact: Artifact, deep: bool) -> list[Damage]:
    found = archive.recall(artifact.archive)
    if found is None:
        return [Damage(artifact.archive, 0, "is damaged: its record cannot be read")]
    if deep and archive.differs(artifact.archive, found):
        return [Damage(artifact.archive, 0, "has other content than was written")]
    return []


def _check_folder(artifact: Artifact, deep: bool) -> list[Damage]:
    from zsmoseg.stores.beginning import array_metadata

    inside = artifact.inside
    if not artifact.laid_out:
        return [Damage(_record(artifact, ABOUT), None, "is missing or damaged")]
    found = [
        Damage(artifact.path / name, None, "is missing" if inside.size(name) is None else "is damaged")
        for array, text in array_metadata(artifact.laid_out).items()
        if inside.read(name := f"{array}/zarr.json") != text
    ]
    done = artifact.done
    if done is None and inside.has(DONE):
        found.append(Damage(_record(artifact, DONE), None, "is damaged"))
    for part in range(len(artifact.parts)):
        found += _check_part(artifact, part, deep)
    return found + (_check_files(artifact, None, done["files"], deep) if done else [])


def _check_part(artifact: Artifact, part: int, deep: bool) -> list[Damage]:
    record = artifact.part(part)
    if record is None:
        there = artifact.inside.has(part_name(part))
        return [Damage(_record(artifact, part_name(part)), part, "is damaged")] if there else []
    return _check_files(artifact, part, record.files, deep)


def _check_files(artifact: Artifact, part: int | None, expected: Expected, deep: bool) -> list[Damage]:
    wrong = wrong_sizes(artifact, part, expected, expected)
    healthy = set(filter(stays, expected))
    healthy -= {damage.path.relative_to(artifact.path).as_posix() for damage in wrong}
    return wrong + (wrong_content(artifact, part, expected, sorted(healthy)) if deep else [])
