"""Which file belongs to which video; names that must stay in their folder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from zsmoseg.errors import FormatError
from zsmoseg.video.places import special
from zsmoseg.video.plain_names import parts_of
from zsmoseg.video.sources import natural

WHOLE = (".npz", ".npy", ".json")
"""Endings of files that hold a whole video."""

FRAME = (".png", ".flo", ".npy", ".npz", ".exr")
"""Endings of files that hold one frame."""

SHOWN = 80
"""Characters of a name in an error."""

DIGITS = 18
"""Of the number of a frame at most; longer ones are hashes."""

OTHERS = "other files and folders beside them"
"""What is left out of a folder."""
SYSTEM = ("thumbs.db", "desktop.ini")
"""Files that systems put into folders."""

SIDES = ("forward", "backward")
"""Folders of flow."""


def not_there(path: Path) -> FormatError:
    """The error for a path that is neither a file nor a folder."""
    found = special(str(path))
    return FormatError(
        f"{path}: {found}; give a file or a folder" if found else f"{path}: no such file or folder"
    )


def find_for_video(path: str | Path, video: str) -> Path:
    """The folder or file of one video.

    Parameters
    ----------
    path
        A file; or a folder that holds one folder or file (npz, npy, json) for each video; or that of the video.
    video
        The video's name in the store.

    Raises
    ------
    FormatError
        If there is none, or two; it says what was looked for.
    """
    path, name = Path(path), str(inside(video, "the name of the video"))
    if path.is_file():
        return path
    if not path.is_dir():
        raise not_there(path)
    looked_for = [path / name, *(path / f"{name}{end}" for end in WHOLE)]
    found = [p for p in looked_for if p.exists()]
    if len(found) > 1:
        raise FormatError(f"{path}: holds {found[0].name} and {found[1].name}; name the one that is meant")
    if found:
        return found[0]
    if any(p.suffix.lower() in FRAME or (p.is_dir() and p.name in SIDES) for p in path.iterdir()):
        return path
    names = ", ".join(p.name for p in looked_for)
    raise FormatError(
        f"{path}: holds no {names}, and no files of frames itself; name the folder or file like the video"
    )


def frame_files(folder: Path, endings: Iterable[str] = FRAME) -> list[Path]:
    """The files of frames in a folder, in natural order.

    Raises
    ------
    FormatError
        If there are several endings: one frame would have two files.
    """
    files = [p for p in folder.iterdir() if p.suffix.lower() in endings and not p.name.startswith(".")]
    found = sorted({p.suffix.lower() for p in files})
    if len(found) > 1:
        raise FormatError(f"{folder}: holds files of several kinds ({', '.join(found)}); keep those of one")
    return sorted(files, key=lambda p: natural(p.name))


def others(folder: Path, taken: Iterable[Path]) -> Counter[str]:
    """How many files and folders of a folder are not taken; hidden ones and those of systems do not count."""
    seen = {p for p in folder.iterdir() if not p.name.startswith(".") and p.name.lower() not in SYSTEM}
    return +Counter({OTHERS: len(seen - set(taken))})


def inside(name: str, where: str) -> PurePosixPath:
    """A relative path that stays in its folder; else a ``FormatError`` that begins with ``where``."""
    try:
        return PurePosixPath(*parts_of(name.replace("\\", "/")))
    except ValueError as error:
        raise FormatError(
            f"{where}: the name {name[:SHOWN]!r} {error}; use a relative one without '..'"
        ) from error


def frame_number(name: str) -> int | None:
    """The last number in a file's name: 12 of ``00012`` and of ``goat_480p_00012``; ``None`` without digits."""
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits and len(digits[-1]) <= DIGITS else None
