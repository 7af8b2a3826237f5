"""Where things are in a store: the one place that knows its folders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from zsmoseg.errors import SpaceError, StoreError
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.records import read_json, write_json
from zsmoseg.stores.schema import FORMAT

MARK = "zsmoseg.json"


@dataclass(frozen=True)
class Store:
    """A store in the folder ``path``; ``open`` checks it, the bare constructor does not."""

    path: Path

    @classmethod
    def open(cls, path: str | Path, create: bool) -> Store:
        """Open a store; ``create``: make it where there is none, and mend its mark.

        Raises
        ------
        StoreError
            Not there, not a store, or written by a newer version.
        """
        store = cls(Path(path))
        mark = read_json(store.path / MARK)
        if mark is not None and "format" in mark:
            if mark["format"] > FORMAT:
                raise StoreError(
                    f"{path}: is a store of format {mark['format']}, this zsmoseg reads up to {FORMAT}; "
                    "use a newer zsmoseg, or another store (--store)"
                )
            return store
        if store.path.exists() and not store._looks_like_one():
            raise StoreError(f"{path}: is not a zsmoseg store and not empty; give another folder (--store)")
        if not store.path.exists() and not create:
            raise StoreError(f"{path}: there is no store; zsmoseg run makes one, --store names another")
        if create:
            try:
                write_json(store.path / MARK, {"format": FORMAT})
            except OSError as error:
                raise SpaceError(f"{path}: cannot be written ({error.strerror})") from error
        return store

    def _looks_like_one(self) -> bool:
        """Empty, or with runs or video folders: its mark was lost."""
        if not self.path.is_dir():
            return False
        entries = [p for p in self.path.iterdir() if p.name != MARK]
        return not entries or (self.path / "runs").is_dir() or any((p / "video.json").exists() for p in entries)

    def videos(self) -> Iterator[str]:
        """The ids of the videos."""
        if self.path.is_dir():
            yield from sorted(p.name for p in self.path.iterdir() if p.is_dir() and p.name != "runs")

    def video_id(self, name: str, fingerprint: str) -> str:
        """The id of a video: that of the folder it has, whatever its name was then, else a new one."""
        known = [video for video in self.videos() if video.endswith(f"-{fingerprint[:16]}")]
        return known[0] if known else f"{name}-{fingerprint[:16]}"

    def artifact(self, video: str, stage: str, key: str) -> Artifact:
        """The artifact of a stage of a video; it need not exist."""
        return Artifact(self.path / video / stage / key)

    def artifacts(self) -> Iterator[Artifact]:
        """All artifacts."""
        for video in self.videos():
            for stage in sorted(p for p in (self.path / video).iterdir() if p.is_dir()):
                yield from (Artifact(p) for p in sorted(stage.iterdir()) if p.is_dir())

    def describe_video(self, video: str, source: str, fingerprint: str) -> None:
        """Note where a video came from."""
        path, content = self.path / video / "video.json", {"source": source, "fingerprint": fingerprint}
        if read_json(path) != content:
            write_json(path, content)

    def fingerprint(self, source: str, method: str) -> str:
        """The fingerprint of a source, looked up by path, size and time of change, else computed and kept."""
        from zsmoseg.sources import fingerprint, stat_signature

        path = self.path / "runs" / "fingerprints" / "cache.json"
        signature = f"{method} {stat_signature(source)}"
        cache = read_json(path) or {}
        if signature not in cache:
            cache[signature] = fingerprint(source, method)
            if (self.path / MARK).exists():
                write_json(path, cache)
        return str(cache[signature])
