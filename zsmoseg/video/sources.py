"""What users point at: files, folders of frames, globs, datasets, by path or URL; and what each video is called."""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from zsmoseg.errors import VideoError
from zsmoseg.remote.looks import any_look
from zsmoseg.remote.url import is_url
from zsmoseg.video import places
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
    for argument in map(places.settled, arguments):
        try:
            for video in _expand(argument):
                files = _images(video) or [video]
                once.setdefault(tuple(places.identity(file) for file in files), video)
        except OSError as error:
            raise VideoError(f"{error.filename or argument}: cannot be read ({error.strerror})") from error
    return list(once.values())


def _expand(argument: str) -> list[str]:
    if places.is_folder(argument):
        return _folder(argument if is_url(argument) else str(Path(argument)))
    if places.is_file(argument):
        if _ending(argument) in IMAGES:
            raise VideoError(
                f"{argument}: is one image; give a video, a folder of frames, or a glob in quotes"
            )
        return [argument]
    if glob.has_magic(argument):
        matches = sorted(places.matches(argument), key=natural)
        if matches and all(_ending(m) in IMAGES for m in matches):
            return [argument]
        wanted = [m for m in matches if places.is_folder(m) or _ending(m) in VIDEOS]
        if wanted:
            return [video for match in wanted for video in _expand(match)]
        if matches:
            raise VideoError(
                f"{argument}: matches {len(matches)} files, of which none is a video or an image"
            )
        raise VideoError(f"{argument}: nothing matches this pattern")
    raise VideoError(f"{argument}: no such file or folder")


def _folder(path: str) -> list[str]:
    """One video if it holds images, else the videos in it and in its folders."""
    if image_files(path):
        return [path]
    for inner in DATASET:
        if places.is_folder(f"{path}/{inner}"):
            return _folder(f"{path}/{inner}")
    entries = sorted(places.children(path), key=natural)
    found = [p for p in entries if _ending(p) in VIDEOS or (places.is_folder(p) and _images(p))]
    if not found:
        raise VideoError(f"{path}: holds neither frames nor videos")
    return found


def image_files(source: str) -> list[str]:
    """The images of a folder or glob in natural order; empty for a video file."""
    if places.is_folder(source):
        names = places.children(source)
    elif not glob.has_magic(source) or places.is_file(source):
        return []
    else:
        names = places.matches(source)
    return sorted((n for n in names if _ending(n) in IMAGES), key=natural)


def _ending(name: str) -> str:
    return os.path.splitext(name)[1].lower()


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
    parts = places.parts(video)
    if glob.has_magic(parts[-1]):
        parts = parts[:-1]
    stem = Path(parts[-1]).stem if _ending(parts[-1]) in VIDEOS else parts[-1]
    return [plain(part) for part in (*parts[:-1], stem)]


def stat_signature(source: str) -> str:
    """Path, size, time of change and inode of every file: what a cached fingerprint is looked up by.

    Of a URL name, size, time and ETag, from one listing.
    """
    with any_look():
        text = "\n".join(places.signature(file) for file in image_files(source) or [source])
    return hashlib.sha256(text.encode()).hexdigest()


def fingerprint(source: str, method: str) -> str:
    """By which a source is known: sha256 of its content, or (``stat``) of names, sizes and times of change."""
    files = image_files(source)
    if method == "stat":
        digests = [places.size_and_time(file) for file in files or [source]]
    else:
        digests = []
        for file in files or [source]:
            with open(places.here(file), "rb") as stream:
                digests.append(hashlib.file_digest(stream, "sha256").hexdigest())
    named = [f"{os.path.basename(f)} {d}" for f, d in zip(files or [""], digests, strict=True)]
    return hashlib.sha256("\n".join(named).encode()).hexdigest()
