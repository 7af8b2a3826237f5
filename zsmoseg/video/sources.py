"""What users point at: files, folders of frames, globs, datasets; and what each video is called."""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from zsmoseg.errors import VideoError
from zsmoseg.video.plain_names import plain

VIDEOS = {".mp4", ".avi", ".mov", ".webm", ".mkv", ".m4v", ".mpg", ".mpeg", ".ogv"}
IMAGES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"}
DATASET = ("JPEGImages/480p", "JPEGImages/Full-Resolution", "JPEGImages")
"""Where dataset folders (DAVIS, YouTube-VOS) keep one folder of frames a video."""


def natural(path: str | Path) -> list[tuple[int, int | str]]:
    """Sort key: ``frame9`` before ``frame10``; ``f01`` and ``f1`` have an order too."""
    parts = re.split(r"(\d+)", str(path))
    return [*((0, int(part)) if part.isdecimal() else (1, part) for part in parts), (2, str(path))]


def sources(arguments: Sequence[str]) -> list[str]:
    """The videos that ``arguments`` mean: each a video file, a folder of images, or a glob of images.

    Returns
    -------
    In the order given; what is the same file, or the same images, only once.

    Raises
    ------
    VideoError
        Where one means nothing, or no video.
    """
    once: dict[tuple[str, ...], str] = {}
    for argument in arguments:
        try:
            for video in _expand(argument):
                files = _images(video) or [video]
                once.setdefault(tuple(os.path.realpath(file) for file in files), video)
        except OSError as error:
            raise VideoError(f"{error.filename or argument}: cannot be read ({error.strerror})") from error
    return list(once.values())


def _expand(argument: str) -> list[str]:
    path = Path(argument)
    if path.is_dir():
        return _folder(path)
    if path.is_file():
        if path.suffix.lower() in IMAGES:
            raise VideoError(
                f"{argument}: is one image; give a video, a folder of frames, or a glob in quotes"
            )
        return [argument]
    if glob.has_magic(argument):
        matches = sorted(glob.glob(argument, recursive=True), key=natural)
        if matches and all(Path(m).suffix.lower() in IMAGES for m in matches):
            return [argument]
        wanted = [m for m in matches if Path(m).is_dir() or Path(m).suffix.lower() in VIDEOS]
        if wanted:
            return [video for match in wanted for video in _expand(match)]
        if matches:
            raise VideoError(
                f"{argument}: matches {len(matches)} files, of which none is a video or an image"
            )
        raise VideoError(f"{argument}: nothing matches this pattern")
    raise VideoError(f"{argument}: no such file or folder")


def _folder(path: Path) -> list[str]:
    """One video if it holds images, else the videos in it and in its folders."""
    if image_files(str(path)):
        return [str(path)]
    for inner in DATASET:
        if (path / inner).is_dir():
            return _folder(path / inner)
    entries = sorted(path.iterdir(), key=natural)
    found = [str(p) for p in entries if p.suffix.lower() in VIDEOS or (p.is_dir() and _images(str(p)))]
    if not found:
        raise VideoError(f"{path}: holds neither frames nor videos")
    return found


def image_files(source: str) -> list[str]:
    """The images of a folder or glob in natural order; empty for a video file."""
    if os.path.isdir(source):
        names = [entry.path for entry in os.scandir(source) if not entry.name.startswith(".")]
    elif os.path.exists(source):
        return []
    else:
        names = glob.glob(source, recursive=True)
    return sorted((n for n in names if os.path.splitext(n)[1].lower() in IMAGES), key=natural)


def _images(source: str) -> list[str]:
    """As ``image_files``; a folder that cannot be listed counts as a video, and fails as one."""
    try:
        return image_files(source)
    except OSError:
        return [source]


def unique_names(videos: Sequence[str]) -> list[str]:
    """The shortest end of each path that is unique among ``videos``: ``goat``, or ``a-clip`` and ``b-clip``.

    Raises
    ------
    VideoError
        If two cannot be told apart by their paths.
    """
    parts = [_parts(video) for video in videos]
    names = []
    for video, own in zip(videos, parts, strict=True):
        for length in range(1, len(own) + 1):
            same = [other for other in parts if other[-length:] == own[-length:]]
            if len(same) == 1:
                names.append(plain("-".join(own[-length:])))
                break
        else:
            twin = next(v for v, p in zip(videos, parts, strict=True) if p[-len(own) :] == own and v != video)
            raise VideoError(f"{video} and {twin} have one name; rename one of them, or run them apart")
    if len(set(names)) < len(names):
        double = next(n for n in names if names.count(n) > 1)
        raise VideoError(f"two sources would both be called {double}; rename one of them, or run them apart")
    return names


def title(video: str) -> str:
    """What a video is called by itself: its folder, or its file without the ending."""
    return _parts(video)[-1]


def _parts(video: str) -> list[str]:
    """The path as names that are safe in file names; a glob is named by its folder."""
    path = Path(os.path.abspath(video))
    if glob.has_magic(path.name):
        path = path.parent
    stem = path.stem if path.suffix.lower() in VIDEOS else path.name
    return [plain(part) for part in (*path.parts[1:-1], stem)]


def stat_signature(source: str) -> str:
    """Path, size, time of change and inode of every file: what a cached fingerprint is looked up by."""
    files = image_files(source) or [source]
    text = "\n".join(
        f"{os.path.realpath(f)} {s.st_size} {s.st_mtime_ns} {s.st_ctime_ns} {s.st_ino}"
        for f in files
        for s in [os.stat(f)]
    )
    return hashlib.sha256(text.encode()).hexdigest()


def fingerprint(source: str, method: str) -> str:
    """By which a source is known: sha256 of its content, or (``stat``) of names, sizes and times of change."""
    files = image_files(source)
    if method == "stat":
        digests = [f"{s.st_size} {s.st_mtime_ns}" for f in files or [source] for s in [os.stat(f)]]
    else:
        digests = []
        for file in files or [source]:
            with open(file, "rb") as stream:
                digests.append(hashlib.file_digest(stream, "sha256").hexdigest())
    named = [f"{os.path.basename(f)} {d}" for f, d in zip(files or [""], digests, strict=True)]
    return hashlib.sha256("\n".join(named).encode()).hexdigest()
