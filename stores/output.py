"""The output folder of one video: the files that a run wrote there, their sizes, and whose they are.

``.zsmoseg.json`` lists them. A run repaints what is missing or differs, removes only files on the list,
and refuses a folder that it did not make.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from zsmoseg.errors import OutputError
from zsmoseg.stores import files
from zsmoseg.stores.records import read_json, write_json

LIST = ".zsmoseg.json"


class Output:
    """The folder ``path``, written for the video ``video`` (its id in the store)."""

    def __init__(self, path: str | Path, video: str) -> None:
        self.path = Path(path)
        self.video = video
        listed = read_json(self.path / LIST) or {}
        self.owner: str | None = listed.get("video")
        self.files: dict[str, dict[str, Any]] = dict(listed.get("files", {}))
        self.stages: dict[str, dict[str, Any]] = dict(listed.get("stages", {}))

    def refuse_foreign(self) -> None:
        """Raise ``OutputError`` if the folder is not ours to write in."""
        for parent in self.path.parents:
            if files.exists(parent) and not files.is_folder(parent):
                raise OutputError(f"{parent}: is a file; give another output folder (-o)")
        if not files.exists(self.path):
            return
        if not files.is_folder(self.path):
            raise OutputError(f"{self.path}: is a file; give another output folder (-o)")
        if not files.exists(self.path / LIST) and files.inside(self.path):
            raise OutputError(
                f"{self.path}: was not made by zsmoseg and is not empty; give another output folder (-o)"
            )
        if self.owner not in (None, self.video) and self.files:
            raise OutputError(
                f"{self.path}: holds the result of another source ({self.owner}, this is {self.video}); "
                "give another output folder (-o) or remove it"
            )

    def problem(self, names: Iterable[str], key: str) -> str | None:
        """Why the files ``names`` cannot stay as they are: missing, of other size, of another key."""
        for name in names:
            entry = self.files.get(name)
            if entry is None:
                return f"{name} not written yet"
            if entry["key"] != key:
                return f"{name} is of other settings"
            size = files.size(self.path / name)
            if size is None:
                return f"{name} is gone"
            if size != entry["size"]:
                return f"{name} was changed"
        return None

    def claim(self, stages: Mapping[str, Mapping[str, Any]]) -> None:
        """Make the folder, put our name on it and what the ``stages`` are about to leave, before the first file."""
        files.make_folder(self.path)
        self.stages.update({name: dict(about) for name, about in stages.items()})
        self._write()

    def add(self, sizes: Mapping[str, int], key: str) -> None:
        """Note files that are written."""
        self.files.update({name: {"size": size, "key": key} for name, size in sizes.items()})
        self._write()

    def write(self, name: str, content: bytes, key: str) -> None:
        """Write a file, whole or not at all, and note it."""
        files.write_whole(self.path / name, content)
        self.add({name: len(content)}, key)

    def remove_others(self, keep: Iterable[str]) -> None:
        """Remove the files of ours that are not among ``keep``."""
        kept = set(keep)
        for name in [n for n in self.files if n not in kept]:
            files.remove(self.path / name)
            del self.files[name]
        self._write()

    def _write(self) -> None:
        write_json(self.path / LIST, {"video": self.video, "files": self.files, "stages": self.stages})
