"""Which of the videos found are meant: by name, by share, those that failed, so many at most."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import PurePath

from zsmoseg.errors import SettingsError, VideoError
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.output import LIST
from zsmoseg.stores.runs import DONE, Entry, latest
from zsmoseg.video import places
from zsmoseg.workflows.running.request import Choice
from zsmoseg.workflows.wording import counted

Named = tuple[str, str]
"""A source and the name of its video."""
SHOWN = 6
"""Names that a message lists."""


def choose(videos: Sequence[Named], choice: Choice, store: Store, out: PurePath | None = None) -> list[Named]:
    """The videos that ``choice`` leaves, in the order given; ``out``: where their output folders are.

    Shares are taken before anything that changes while other shares run, so each video is in exactly one.

    Raises
    ------
    SettingsError
        If a name or pattern of ``only`` is that of no video.
    """
    chosen = _named(videos, choice.only) if choice.only else list(videos)
    if choice.share:
        mine = share([name for _, name in chosen], *choice.share)
        chosen = [video for video in chosen if video[1] in mine]
    if choice.retry_failed:
        again = unfinished(store, chosen, out)
        chosen = [video for video in chosen if video[1] in again]
    return chosen[: choice.limit]


def without_outputs(videos: Sequence[str], given: Sequence[str]) -> tuple[list[str], str]:
    """The videos without what runs have left: an output folder is known by its list; and a line about what is passed over.

    Parameters
    ----------
    given
        What the user wrote: a file or folder that is named itself is meant.

    Raises
    ------
    VideoError
        Nothing else is there.
    """
    known, named = dict[PurePath, bool](), {places.settled(source).rstrip("/") for source in given}

    def is_output(folder: PurePath) -> bool:
        if folder not in known:
            known[folder] = files.signature(folder / LIST) is not None
        return known[folder]

    wrote: dict[str, PurePath] = {}
    for video in videos:
        above = [] if video in named else list(files.folder(video).parents)[:2]
        if folder := next(filter(is_output, above), None):
            wrote[video] = folder
    if not wrote:
        return list(videos), ""
    folders = list(dict.fromkeys(wrote.values()))
    more = f" and {len(folders) - 1} more" if len(folders) > 1 else ""
    line = f"{folders[0]}{more}: output of zsmoseg"
    left = [video for video in videos if video not in wrote]
    if not left:
        raise VideoError(f"{line}; give the videos that it was made from")
    return left, f"{line}, passed over; name a file in it to have that segmented"


def _named(videos: Sequence[Named], patterns: Sequence[str]) -> list[Named]:
    names = [name for _, name in videos]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            raise SettingsError(
                f"--only {pattern}: no video has this name; there are {', '.join(names[:SHOWN])}{more}"
            )
    return [v for v in videos if any(fnmatchcase(v[1], pattern) for pattern in patterns)]


def share(names: Sequence[str], i: int, n: int) -> set[str]:
    """Every n-th name in the order of the alphabet, from the i-th on: each name is in exactly one of n shares."""
    return set(sorted(names)[i - 1 :: n])


def unfinished(store: Store, videos: Sequence[Named], out: PurePath | None = None) -> set[str]:
    """Those of the ``videos`` that failed when they ran last, or that their last run did not finish.

    Other videos may have the same names: what counts is a run with the same source and output folder, else with the same
    source, else (the source was moved) with the same output folder.
    """
    sources = {name: source for source, name in videos}

    def is_source(entry: Entry) -> bool:
        return entry.name in sources and entry.source in ("", sources[entry.name])

    def is_out(entry: Entry) -> bool:
        return out is None or entry.out in ("", files.absolute(out / entry.name))

    both = latest(store, lambda entry: is_source(entry) and is_out(entry))
    found = {**latest(store, is_out), **latest(store, is_source), **both}
    return {name for name, entry in found.items() if entry.outcome != DONE}


def nothing_left(found: int, choice: Choice) -> str:
    """Why no video is left to run, in words."""
    if choice.retry_failed:
        return f"nothing to retry: of {counted(found, 'video')} none failed when it ran last with this store"
    i, n = choice.share or (1, 1)
    return f"nothing to do: share {i} of {n} holds none of the {counted(found, 'video')}"
