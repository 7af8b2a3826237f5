"""What a thread has listed already: it need not ask a server again. Standard library only."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from zsmoseg.remote.url import URL


class Stat(NamedTuple):
    """What a listing says of a file.

    Attributes
    ----------
    modified
        Time of its last change, ns, by the clock of where it lies.
    size
        Bytes.
    stamp
        Changes whenever the content does; on a server its ETag.
    """

    modified: int
    size: int
    stamp: str


_looks = threading.local()


@contextmanager
def one_look() -> Iterator[None]:
    """Within the block this thread lists each folder once at most, and asks for no file in one that it listed.

    What it writes or removes meanwhile it knows; what others do it sees at its next look. Looks nest: the inner one
    knows what the outer one has seen, and forgets the rest at its end.
    """
    outer: dict[URL, dict[str, Stat]] | None = getattr(_looks, "seen", None)
    _looks.seen = dict(outer or {})
    try:
        yield
    finally:
        _looks.seen = outer


@contextmanager
def any_look() -> Iterator[None]:
    """The look that is under way, or one for this block."""
    if getattr(_looks, "seen", None) is not None:
        yield
    else:
        with one_look():
            yield


@contextmanager
def no_look() -> Iterator[None]:
    """Within the block this thread asks anew for everything: for what others may have changed since."""
    outer, _looks.seen = getattr(_looks, "seen", None), None
    before, _looks.hidden = getattr(_looks, "hidden", None), outer or getattr(_looks, "hidden", None)
    try:
        yield
    finally:
        _looks.seen, _looks.hidden = outer, before


def seen(url: URL, itself: bool = True) -> tuple[URL, dict[str, Stat]] | None:
    """The listing, of this look, of a folder that holds ``url``, or (``itself``) of the folder ``url``."""
    seen: dict[URL, dict[str, Stat]] | None = getattr(_looks, "seen", None)
    if not seen:
        return None
    places = (url, *url.parents) if itself else url.parents
    return next(((place, seen[place]) for place in places if place in seen), None)


def note(url: URL, stat: Stat | None) -> None:
    """What this thread did to a file."""
    seen: dict[URL, dict[str, Stat]] = getattr(_looks, "seen", None) or getattr(_looks, "hidden", None) or {}
    for place in url.parents:
        if place in seen:
            name = str(url.relative_to(place))
            if stat is None:
                seen[place].pop(name, None)
            else:
                seen[place][name] = stat


def keep(url: URL, files: dict[str, Stat]) -> None:
    """Remember the listing of a folder to the end of the look, if there is one."""
    if getattr(_looks, "seen", None) is not None:
        _looks.seen[url] = files
