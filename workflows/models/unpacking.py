"""Zip archives of models: only the wanted files come out, and nothing gets past the folder or the size."""

from __future__ import annotations

import lzma
import stat
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path, PurePosixPath

from zsmoseg.errors import ModelError
from zsmoseg.video.plain_names import stays

CHUNK = 1 << 20


def unpack(archive: Path, wanted: Collection[str], folder: Path, most: int) -> None:
    """Take files out of a zip archive, wherever in it they lie.

    Parameters
    ----------
    archive
        The zip file.
    wanted
        Plain names of the files; others stay inside.
    folder
        Where they go.
    most
        Bytes that they may have together.

    Raises
    ------
    ModelError
        No zip file, a damaged one, a name that leaves the folder, a link, a file that is missing or there
        twice, more bytes than ``most``.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            chosen = _choose(opened, wanted, archive)
            size = sum(member.file_size for member in chosen.values())
            if size > most:
                raise ModelError(
                    f"{archive}: unpacks to {size} bytes, more than the {most} expected; refused"
                )
            for name, member in chosen.items():
                _take(opened, member, folder / name)
    except (
        zipfile.BadZipFile,
        EOFError,
        NotImplementedError,
        RuntimeError,
        zlib.error,
        lzma.LZMAError,
    ) as error:
        raise ModelError(f"{archive}: is no sound zip file ({error}); nothing was taken from it") from error


def _choose(opened: zipfile.ZipFile, wanted: Collection[str], archive: Path) -> dict[str, zipfile.ZipInfo]:
    """The members that are wanted, after a look at the names of all."""
    chosen: dict[str, zipfile.ZipInfo] = {}
    for member in opened.infolist():
        path = PurePosixPath(member.filename.replace("\\", "/"))
        if path.parts and not stays(path.as_posix()):
            raise ModelError(
                f"{archive}: {member.filename!r} leads out of the folder; the archive is refused"
            )
        if stat.S_ISLNK(member.external_attr >> 16):
            raise ModelError(f"{archive}: {member.filename!r} is a link; the archive is refused")
        if path.name in wanted and not member.is_dir():
            if path.name in chosen:
                raise ModelError(f"{archive}: has {path.name} twice; the archive is refused")
            chosen[path.name] = member
    if lacking := sorted(set(wanted) - set(chosen)):
        raise ModelError(f"{archive}: lacks {', '.join(lacking)}")
    return chosen


def _take(opened: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path) -> None:
    """Copy one member; never more than its entry states, whatever the packed bytes unpack to."""
    left = member.file_size
    with opened.open(member) as source, target.open("wb") as out:
        while piece := source.read(CHUNK):
            left -= len(piece)
            if left < 0:
                raise zipfile.BadZipFile(f"{member.filename} is larger than it says")
            out.write(piece)
    if left:
        raise zipfile.BadZipFile(f"{member.filename} is shorter than it says")
