"""Which entry of somebody's files belongs to which frame of a video: by whole names, else by the one number in them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from zsmoseg.errors import FormatError
from zsmoseg.formats.names import DIGITS, frame_number

NUMBERED = re.compile(r"[^\W\d_]*(\d+)|(\d{3,})[^\W\d_]+")
"""A word with one number, as ``00012``, ``frame12`` and ``480p``; most hashes have several, or a short one in front."""

WORD = re.compile(r"[^\W_]+")


def match_frames(
    entries: Sequence[str] | range | int, names: Sequence[str], where: str | Path = "the source"
) -> list[int | None]:
    """Which entry of a source belongs to each frame of a video.

    Parameters
    ----------
    entries
        Names of the entries: the frame of the same name; else the one whose name stands in it by itself
        (``00012_png.rf.8c1bd4fe``, ``goat-00012``); else the one with the same number (``00012`` and ``frame12``).
        Without names: their number, which must be that of the frames, or the range of the frames that they are.
    names
        Of the frames of the video (of flow: all but the last).
    where
        What an error begins with.

    Returns
    -------
    For each frame the index of its entry, None where it has none.

    Raises
    ------
    FormatError
        If an entry belongs to no frame, or may belong to two; or two belong to one.

    Examples
    --------
    >>> match_frames(["frame2", "frame1"], ["00001", "00002", "00003"])
    [1, 0, None]
    """
    if isinstance(entries, int):
        if entries != len(names):
            raise FormatError(
                f"{where}: holds {entries} entries without names for {len(names)} frames; give one for each"
            )
        return list(range(entries))
    if isinstance(entries, range):
        if entries and entries[-1] >= len(names):
            raise FormatError(
                f"{where}: frame {entries[-1]} is beyond the last of the video ({len(names)} frames)"
            )
        return [entries.index(t) if t in entries else None for t in range(len(names))]
    return _match_names(entries, names, where)


def _match_names(entries: Sequence[str], names: Sequence[str], where: str | Path) -> list[int | None]:
    frames, common = _Frames(names), _common_words(entries)
    out: list[int | None] = [None] * len(names)
    for i, entry in enumerate(entries):
        found = frames.of(entry, common)
        if not found:
            _refuse_other_beginning(entries, names, where)
            raise FormatError(
                f"{where}: {entry} belongs to no frame of the video ({names[0]} to {names[-1]}); rename or remove it"
            )
        if len(found) > 1:
            one, two, *_ = found
            raise FormatError(f"{where}: {entry} may belong to {one} or to {two}; call it like its frame")
        t = found.popitem()[1]
        other = out[t]
        if other is not None:
            raise FormatError(
                f"{where}: {entries[other]} and {entry} both belong to frame {names[t]}; keep one"
            )
        out[t] = i
    return out


def _refuse_other_beginning(entries: Sequence[str], names: Sequence[str], where: str | Path) -> None:
    """Raise where as many entries as frames count on from another number: all are meant, each by another frame."""
    first, start = (_counting(called) for called in (entries, names))
    if len(entries) == len(names) and None not in (first, start) and first != start:
        raise FormatError(
            f"{where}: counts from {first} ({entries[0]} to {entries[-1]}), the frames of the video from {start} ({names[0]} to "
            f"{names[-1]}); rename all, so that each is called like its frame"
        )


def _counting(names: Sequence[str]) -> int | None:
    """The number that names count from, one by one, in any order; None where they do not."""
    found = sorted(number for name in names if (number := frame_number(name)) is not None)
    counts = len(found) == len(names) and found == list(range(found[0], found[0] + len(found)))
    return found[0] if counts else None


class _Frames:
    """The frames of a video by name and by number."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._exact = {name: t for t, name in enumerate(names)}
        common = _common_words(names)
        numbers = [_numbers(w for w in _words(name) if w not in common) for name in names]
        single = [next(iter(n)) if len(n) == 1 else None for n in numbers]
        count = Counter(single)
        self._numbered = {n: t for t, n in enumerate(single) if n is not None and count[n] == 1}

    def of(self, entry: str, common: set[str]) -> dict[str, int]:
        """What may be the frame of an entry, each with what tells so.

        Parameters
        ----------
        common : words of all entries, which tell none from another.
        """
        if entry in self._exact:
            return {f"frame {entry}": self._exact[entry]}
        named = self._named(entry)
        if named:
            inside = {word for name in named for word in _words(name)}
            rivals = _numbers(w for w in _words(entry) if w.isdecimal() and w not in common | inside)
            frames = {*named.values(), *(self._numbered[n] for n in rivals if n in self._numbered)}
            return {f"frame {self._names[t]}": t for t in sorted(frames)}
        kept = {word for word in common if not _numbers([word]) & self._numbered.keys()}
        numbers = sorted(_numbers(w for w in _words(entry) if w not in kept))
        if len(numbers) == 1 and numbers[0] not in self._numbered:
            return {}
        return {f"the frame of number {n}": self._numbered.get(n, -1) for n in numbers}

    def _named(self, entry: str) -> dict[str, int]:
        """The frames whose whole name stands in an entry, no letter or digit before or behind it; the longest ones."""
        edges = [0, *(e for m in WORD.finditer(entry) for e in m.span()), len(entry)]
        spans = [
            (a, b)
            for a in dict.fromkeys(edges)
            for b in dict.fromkeys(edges)
            if a < b and entry[a:b] in self._exact
        ]
        whole = [
            (a, b) for a, b in spans if not any(c <= a and b <= d and (a, b) != (c, d) for c, d in spans)
        ]
        return {entry[a:b]: self._exact[entry[a:b]] for a, b in whole}


def _words(name: str) -> list[str]:
    return WORD.findall(name)


def _common_words(names: Sequence[str]) -> set[str]:
    """Words that all of several names have."""
    found = [set(_words(name)) for name in names]
    return set.intersection(*found) if len(found) > 1 else set()


def _numbers(words: Iterable[str]) -> set[int]:
    """The numbers that stand in words."""
    matches = map(NUMBERED.fullmatch, words)
    digits = [m[1] or m[2] for m in matches if m]
    return {int(number) for number in digits if len(number) <= DIGITS}
