"""What users point at: files, folders of frames, globs, datasets, by path or URL; and what each video is called."""

from __future__ import annotations

import glob
import hashlib
import os
import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from zsmoseg.errors import VideoError
from zsmoseg.remote.looks import any_look
from zsmoseg.remote.url import is_url
from zsmoseg.video import places
from zsmoseg.video.plain_names import plain

VIDEOS = {
    *(
        ".mp4",
        ".avi",
        ".mov",
        ".webm",
        ".mkv",
        ".m4v",
        ".mpg",
        ".mpeg",
        ".ogv",
        ".ogm",
        ".flv",
        ".f4v",
        ".wmv",
        ".asf",
    ),
    *(
        ".3gp",
        ".3g2",
        ".ts",
        ".mts",
        ".m2ts",
        ".m2t",
        ".vob",
        ".mxf",
        ".dv",
        ".ivf",
        ".y4m",
        ".nut",
        ".obu",
        ".mjpeg",
    ),
    *(".mjpg", ".h264", ".264", ".avc", ".h265", ".265", ".hevc", ".m2v"),
}
ENDING = re.compile(r"\.[A-Za-z0-9]{1,5}")
"""Of a file, what its name ends with and is not called by."""
THUMBNAILS = 3
"""Images a video up to which those beside videos are pictures of them, as download tools put them there."""
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
                once.setdefault(places.identities(files), video)
        except OSError as error:
            raise VideoError(f"{error.filename or argument}: cannot be read ({error.strerror})") from error
    return list(once.values())


def _expand(argument: str) -> list[str]:
    if places.is_folder(argument):
        found = _folder(argument if is_url(argument) else str(Path(argument)))
        if not found:
            raise VideoError(f"{argument}: holds neither frames nor videos")
        return found
    if places.is_file(argument):
        if _ending(argument) in IMAGES:
            raise VideoError(
                f"{argument}: is one image; give a video, a folder of frames, or a glob in quotes"
            )
        return [argument]
    if glob.has_magic(argument):
        return _pattern(argument)
    raise places.nothing_there(argument)


def _pattern(pattern: str) -> list[str]:
    """The videos, and those in the folders, that have such a name; where there are images alone, one a folder."""
    matches = sorted(places.matches(pattern), key=natural)
    if not matches:
        raise VideoError(f"{pattern}: nothing matches this pattern")
    _refuse_mixed(pattern, matches)
    images, videos = _kinds(matches)
    if (len(images) > 1 and not videos) or len(images) == len(matches):
        folders = dict.fromkeys(image.rpartition("/")[0] for image in images)
        last = pattern.rpartition("/")[2].replace("**", "*")
        return [pattern] if len(folders) == 1 else [places.within(folder or ".", last) for folder in folders]
    found = [video for match in matches if not _shows(match, videos) for video in _within(match, deeper=True)]
    if not found:
        raise VideoError(f"{pattern}: matches {len(matches)} files, of which none is a video or an image")
    return found


def _folder(path: str, deeper: bool = True) -> list[str]:
    """One video if it holds images, else the videos in it and, ``deeper``, in its folders."""
    names = sorted(places.children(path), key=natural)
    images, videos = _kinds(names)
    if len(images) > 1 and not videos:
        return [path]
    _refuse_mixed(path, names)
    for inner in DATASET if deeper else ():
        if places.is_folder(f"{path}/{inner}"):
            return _folder(f"{path}/{inner}")
    found = [video for name in names if not _shows(name, videos) for video in _within(name, deeper)]
    return found or [path] * bool(images)


def _kinds(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """The images and the videos."""
    images, videos = ([name for name in names if _ending(name) in endings] for endings in (IMAGES, VIDEOS))
    return images, videos


def _within(name: str, deeper: bool) -> list[str]:
    """What one entry of a folder holds; a folder that cannot be listed counts as a video, and fails as one."""
    if not places.is_folder(name):
        return [name] if _ending(name) in VIDEOS else []
    try:
        return _folder(name, deeper=False) if deeper else []
    except OSError:
        return [name]


def _shows(folder: str, videos: Sequence[str]) -> bool:
    """Whether this is a folder of pictures of the videos beside it, called like those."""
    stems = tuple(Path(video).stem for video in videos)
    images = _images(folder) if stems and places.is_folder(folder) else []
    return bool(images) and all(Path(image).name.startswith(stems) for image in images)


def _refuse_mixed(place: str, names: Sequence[str]) -> None:
    """Raise where images beside videos are too many to be pictures of those."""
    images, videos = _kinds(names)
    if videos and len(images) > THUMBNAILS * len(videos):
        raise VideoError(
            f"{place}: holds {len(images)} images beside videos ({len(videos)}); give the videos, or a glob of the images "
            "in quotes"
        )


def image_files(source: str) -> list[str]:
    """The images of a folder or glob in natural order; empty for a video file."""
    if places.is_folder(source):
        names = places.children(source)
    elif not places.is_pattern(source):
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
    told = [_parts(video) for video in videos]
    parts = [[plain(part) for part in own] for own in told]
    names = []
    for video, own, said in zip(videos, parts, told, strict=True):
        for length in range(1, len(own) + 1):
            same = [other for other in parts if other[-length:] == own[-length:]]
            if len(same) == 1:
                names.append(plain("-".join(own[-length:])))
                break
        else:
            twin = next(
                (v for v, other in zip(videos, told, strict=True) if other == said and v != video), None
            )
            if twin is not None:
                raise VideoError(f"{video} and {twin} have one name; rename one of them, or run them apart")
            names.append(plain(said[-1], tagged=True))
    if len(set(names)) < len(names):
        double = next(n for n in names if names.count(n) > 1)
        raise VideoError(f"two sources would both be called {double}; rename one of them, or run them apart")
    return names


def title(video: str) -> str:
    """What a video is called by itself: its folder, or its file without the ending."""
    return plain(_parts(video)[-1])


def _parts(video: str) -> list[str]:
    """The path, without the ending of a file; a pattern is called like its folder."""
    parts = [unicodedata.normalize("NFC", part) for part in places.parts(video)]
    if places.is_pattern(video):
        return [places.unescaped(part) for part in parts[:-1]]
    is_file = _ending(parts[-1]) in VIDEOS or (
        ENDING.fullmatch(_ending(parts[-1])) and not places.is_folder(video)
    )
    return [*parts[:-1], Path(parts[-1]).stem] if is_file else parts


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
