"""Which of the videos found are meant: by name, by share, those that failed, so many at most."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from zsmoseg.errors import SettingsError
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import DONE, latest
from zsmoseg.workflows.running.request import Choice
from zsmoseg.workflows.wording import counted

Named = tuple[str, str]
"""A source and the name of its video."""
SHOWN = 6
"""Names that a message lists."""


def choose(videos: Sequence[Named], choice: Choice, store: Store) -> list[Named]:
    """The videos that ``choice`` leaves, in the order given.

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
        again = unfinished(store)
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


def unfinished(store: Store) -> set[str]:
    """Videos that failed when they ran last, or that their last run did not finish."""
    return {name for name, entry in latest(store).items() if entry.outcome != DONE}


def nothing_left(found: int, choice: Choice) -> str:
    """Why no video is left to run, in words."""
    if choice.retry_failed:
        return f"nothing to retry: of {counted(found, 'video')} none failed when it ran last with this store"
    i, n = choice.share or (1, 1)
    return f"nothing to do: share {i} of {n} holds none of the {counted(found, 'video')}"
