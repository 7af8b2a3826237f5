"""What a thread has asked already: it need not ask a server again. Standard library only."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
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


@dataclass(frozen=True)
class _Look:
    """Of folders that were listed all files, by relative path; of other files what a server said of each."""

    listed: dict[URL, dict[str, Stat]] = field(default_factory=dict)
    asked: dict[URL, Stat | None] = field(default_factory=dict)


class _Looks(threading.local):
    """The looks of a thread, the inner one last; None where ``no_look`` hides those before."""

    def __init__(self) -> None:
        self.nested: list[_Look | None] = []

    @property
    def now(self) -> _Look | None:
        """The one that is under way."""
        return self.nested[-1] if self.nested else None


_looks = _Looks()


@contextmanager
def one_look() -> Iterator[None]:
    """Within the block this thread lists each folder and asks for each file once at most, for none in a folder that it listed.

    What it writes or removes meanwhile it knows; what others do it sees at its next look. Looks nest: the inner one
    knows what the outer one has seen, and forgets the rest at its end.
    """
    outer = _looks.now
    with _nested(_Look(dict(outer.listed), dict(outer.asked)) if outer else _Look()):
        yield


@contextmanager
def any_look() -> Iterator[None]:
    """The look that is under way, or one for this block."""
    if looking():
        yield
    else:
        with one_look():
            yield


@contextmanager
def no_look() -> Iterator[None]:
    """Within the block this thread asks anew for everything: for what others may have changed since."""
    with _nested(None):
        yield


@contextmanager
def _nested(look: _Look | None) -> Iterator[None]:
    _looks.nested.append(look)
    try:
        yield
    finally:
        _looks.nested.pop()


def looking() -> bool:
    """Whether a look is under way in this thread."""
    return _looks.now is not None


def listed(url: URL, itself: bool = True) -> tuple[URL, dict[str, Stat]] | None:
    """The listing, of this look, of a folder that holds ``url``, or (``itself``) of the folder ``url``."""
    look = _looks.now
    if not look or not look.listed:
        return None
    places = (url, *url.parents) if itself else url.parents
    return next(((place, look.listed[place]) for place in places if place in look.listed), None)


def asked(url: URL, ask: Callable[[], Stat | None]) -> Stat | None:
    """What ``ask`` says of a file, asked once a look."""
    look = _looks.now
    if look is None:
        return ask()
    if url not in look.asked:
        look.asked[url] = ask()
    return look.asked[url]


def note(url: URL, stat: Stat | None) -> None:
    """What this thread did to a file, for all looks that are under way."""
    for look in filter(None, _looks.nested):
        look.asked[url] = stat
        for place in url.parents:
            if place in look.listed:
                name = str(url.relative_to(place))
                if stat is None:
                    look.listed[place].pop(name, None)
                else:
                    look.listed[place][name] = stat


def keep(url: URL, files: dict[str, Stat]) -> None:
    """Remember the listing of a folder to the end of the look, if there is one."""
    if _looks.now is not None:
        _looks.now.listed[url] = files
