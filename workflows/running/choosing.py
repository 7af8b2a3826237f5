"""Which of the videos found are meant: by name, by share, those that failed, so many at most."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import PurePath

from zsmoseg.errors import SettingsError
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import DONE, Entry, latest
from zsmoseg.workflows.running.request import Choice

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
        return f"nothing to retry: of {found} videos none failed when it ran last with this store"
    i, n = choice.share or (1, 1)
    return f"nothing to do: share {i} of {n} holds none of the {found} videos"
