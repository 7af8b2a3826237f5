"""The output folder of one video: the files that a run wrote there, what is in them, and whose they are.

``.zsmoseg.json`` lists them, with sizes and checksums. A run repaints what is missing or differs, removes only files
on the list, and refuses a folder that it did not make. A list that was lost is made again, with all that it listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import PurePath
from typing import Any

from zsmoseg.errors import OutputError
from zsmoseg.stores import files
from zsmoseg.stores.checks import Damage
from zsmoseg.stores.location import Store
from zsmoseg.stores.records import as_json, read_json, read_record, write_record
from zsmoseg.stores.runs import outputs
from zsmoseg.video.plain_names import stays

LIST = ".zsmoseg.json"
LEASE = ".zsmoseg.lease"
"""In an output folder while a run works on it."""
SUMMARY, STATES = "summary.json", "motion.csv"
"""What a run leaves beside the files of the stages."""
DIGITS = 16
"""Of the fingerprint of a video, at the end of its id."""
ENTRY = {"size": int, "crc32": int, "stamp": str, "key": str}
"""What the list has of each file."""


def place(folder: PurePath, name: str) -> PurePath:
    """Where a file of an output folder is.

    Raises
    ------
    OutputError
        The folder is a link, if only since the run was planned, or a part of the name is.
    """
    _refuse_link(folder)
    return files.below(folder, name, OutputError)


def _refuse_link(folder: PurePath) -> None:
    if files.is_link(folder):
        raise OutputError(f"{folder}: is a link; give the folder itself as output folder (-o)")


class Output:
    """The folder ``path``, written for the video ``video`` (its id in the store)."""

    def __init__(self, path: str | PurePath, video: str) -> None:
        self.path = files.folder(path)
        self.video = video
        listed = _read_list(self.path / LIST)
        self.listed = listed is not None
        self._listed = as_json(listed or {})
        content = listed or {"video": None, "files": {}, "stages": {}}
        self.owner: str | None = content["video"]
        self.files: dict[str, dict[str, Any]] = content["files"]
        self.stages: dict[str, dict[str, Any]] = content["stages"]

    @property
    def lease(self) -> PurePath:
        """The lease of who works on it."""
        return place(self.path, LEASE)

    @property
    def stamp(self) -> str | None:
        """What changes with its list."""
        return files.stamp(self.path / LIST)

    @property
    def foreign(self) -> bool:
        """Whether the list is of another source; the fingerprint counts, people may call a video otherwise."""
        return self.owner is not None and self.owner[-DIGITS:] != self.video[-DIGITS:]

    def refuse_foreign(self, ours: Iterable[str] = (), store: Store | None = None) -> None:
        """Raise ``OutputError`` if the folder is not ours to write in.

        Parameters
        ----------
        ours
            What will be written there.
        store
            Where a folder that lost its list may be known from: it is ours if it holds nothing but ``ours``.
        """
        _refuse_link(self.path)
        _refuse_link(self.path.parent)
        if file := files.in_the_way(self.path):
            raise OutputError(f"{file}: is a file; give another output folder (-o)")
        if self.foreign and self._described():
            self._lose_list()
        if self.foreign and self.files:
            raise OutputError(
                f"{self.path}: holds the result of another source ({self.owner}, this is {self.video}); "
                "give another output folder (-o) or remove it"
            )
        if self.listed or not files.exists(self.path):
            return
        known = self._known(store)
        strange = sorted(set(files.tree(self.path)) - {LIST, LEASE} - (set(ours) if known else set()))
        if strange and known:
            raise OutputError(
                f"{self.path}: its list {LIST} is lost or damaged, and it holds {strange[0]}, which this run would "
                "not write; take that out of it, or give another output folder (-o)"
            )
        if strange:
            raise OutputError(
                f"{self.path}: was not made by zsmoseg and is not empty; give another output folder (-o)"
            )

    def _known(self, store: Store | None) -> bool:
        """Whether a folder without a list was this video's: by a list that is damaged, the summary, or the runs."""
        if files.exists(self.path / LIST) and not files.is_link(self.path / LIST):
            return True
        if self._described():
            return True
        return (
            store is not None
            and outputs(store).get(files.absolute(self.path), "")[-DIGITS:] == self.video[-DIGITS:]
        )

    def _described(self) -> bool:
        """Whether the summary is one of this video."""
        path = self.path / SUMMARY
        found = None if files.is_link(path) else read_json(path)
        return str((found or {}).get("fingerprint"))[:DIGITS] == self.video[-DIGITS:]

    def _lose_list(self) -> None:
        """The list is that of another folder."""
        self.listed, self.owner, self.files, self.stages = False, None, {}, {}

    def problem(self, names: Iterable[str], key: str) -> str | None:
        """Why the files ``names`` cannot stay as they are: missing, of other content, of another key.

        A file that nobody touched since it was written is not read again; ``damages`` reads them all.
        """
        for name in names:
            entry = self.files.get(name)
            if entry is None:
                return f"{name} not written yet"
            if entry["key"] != key:
                return f"{name} is of other settings"
            path = place(self.path, name)
            if _differs(path, entry):
                return f"{name} is gone" if files.size(path) is None else f"{name} was changed"
        return None

    def damages(self) -> Iterator[tuple[str, str]]:
        """Files that are not as they were written: the name, and what is wrong. All of them are read."""
        for name, entry in self.files.items():
            try:
                path = files.below(self.path, name, OutputError)
            except OutputError:
                yield name, "is or lies behind a link"
                continue
            if files.size(path) is None:
                yield name, "is missing"
            elif _differs(path, entry, deep=True):
                yield name, "has other content than was written"

    def refuse_gaps(self, names: Iterable[str]) -> None:
        """Raise ``OutputError`` if one of the files ``names`` is not there as it was noted; by one listing, and sizes."""
        there = files.listing(self.path)
        for name in names:
            noted = self.files.get(name)
            if noted is None or name not in there or there[name].size != noted["size"]:
                what = "was changed" if name in there else "is gone"
                raise OutputError(
                    f"{self.path / name}: {what} since this run wrote it; run the same command again"
                )

    def claim(self, stages: Mapping[str, Mapping[str, Any]]) -> None:
        """Make the folder, put our name on it and what the ``stages`` are about to leave, before the first file."""
        files.make_folder(self.path)
        self.stages.update({name: dict(about) for name, about in stages.items()})
        self._write()

    def add(self, entries: Mapping[str, Mapping[str, Any]], key: str) -> None:
        """Note files that are written: what ``files.noted`` says of each."""
        self.files.update({name: {**entry, "key": key} for name, entry in entries.items()})
        self._write()

    def write(self, name: str, content: bytes, key: str) -> None:
        """Write a file, whole or not at all, and note it; not if it is there with this content."""
        old, found = self.files.get(name), {"size": len(content), "crc32": files.crc32(content), "key": key}
        if old and found.items() <= old.items() and not _differs(self.path / name, old):
            return
        self.add({name: files.write_noted(place(self.path, name), content)}, key)

    def finish(self, contents: Mapping[str, bytes], key: str, keep: Iterable[str]) -> None:
        """Write the last files, and remove those of ours that are neither these nor among ``keep``."""
        if not self.listed:
            self.claim({})
        for name, content in contents.items():
            noted = files.write_noted(place(self.path, name), content)
            self.files[name] = {**noted, "key": key}
        self.remove_others([*keep, *contents])

    def remove_others(self, keep: Iterable[str]) -> None:
        """Remove the files of ours that are not among ``keep``; what lies behind a link is no longer ours.

        What killed runs left unfinished goes too, when it is old enough to be nobody's.
        """
        _refuse_link(self.path)
        for leftover in files.leftovers(self.path):
            files.remove(leftover)
        kept = set(keep)
        for name in [n for n in self.files if n not in kept]:
            with suppress(OutputError):
                files.unlink(files.below(self.path, name, OutputError))
            del self.files[name]
        self._write()

    def forget(self, names: Iterable[str]) -> None:
        """Strike files off the list: the next run writes them again."""
        for name in names:
            del self.files[name]
        self._write()

    @property
    def changed(self) -> bool:
        """Whether the list is another than when it was read: a file that was touched is as it was, say."""
        return self._content() != self._listed

    def _content(self) -> dict[str, Any]:
        return as_json({"video": self.video, "files": self.files, "stages": self.stages})

    def _write(self) -> None:
        content = self._content()
        if content == self._listed:
            return
        self._listed = content
        write_record(place(self.path, LIST), content)


def _differs(path: PurePath, entry: dict[str, Any], deep: bool = False) -> bool:
    """Whether a file is not as its entry says; one that is notes its new stamp, so that it is read only once."""
    stamp = files.stamp(path)
    if not deep and stamp == entry["stamp"]:
        return False
    content = files.read(path) if stamp and files.size(path) == entry["size"] else None
    if content is None or files.crc32(content) != entry["crc32"]:
        return True
    entry["stamp"] = stamp
    return False


def _read_list(path: PurePath) -> dict[str, Any] | None:
    """The list of a folder; None where it is missing, damaged, a link, or names what does not lie in the folder."""
    found = None if files.is_link(path) else read_record(path)
    if not found or not isinstance(found.get("video"), str):
        return None
    listed, stages = found.get("files"), found.get("stages")
    if not isinstance(listed, dict) or not isinstance(stages, dict):
        return None
    sound = all(stays(name) and name != LIST and _is_entry(entry) for name, entry in listed.items())
    return found if sound and all(map(_is_description, stages.values())) else None


def _is_entry(entry: object) -> bool:
    return (
        isinstance(entry, dict)
        and entry.keys() == ENTRY.keys()
        and all(type(entry[name]) is kind for name, kind in ENTRY.items())
    )


def _is_description(about: object) -> bool:
    """Whether it is what a plan can compare itself with."""
    if not isinstance(about, dict) or not isinstance(about.get("inputs", {}), dict):
        return False
    settings = about.get("settings", {})
    return isinstance(settings, dict) and all(isinstance(section, dict) for section in settings.values())


def known_outputs(store: Store) -> Iterator[tuple[Output, list[Damage]]]:
    """The folders that runs of a store wrote to, and what is wrong with each.

    A folder that is gone was taken away by whoever it belongs to.
    """
    for place, video in outputs(store).items():
        path = files.folder(place)
        if files.is_link(path) or not files.is_folder(path):
            continue
        with files.looking_at(path):
            output = Output(path, video)
            found = _damages(output)
        yield output, found


def _damages(output: Output) -> list[Damage]:
    path = output.path
    if not output.listed:
        return [Damage(path / LIST, None, "is missing or damaged")]
    if output.foreign:
        return [Damage(path / LIST, None, f"lists the files of another source ({output.owner})")]
    return [Damage(path / name, None, what) for name, what in output.damages()]
