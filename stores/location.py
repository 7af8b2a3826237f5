"""Where things are in a store: the one place that knows its folders.

    STORE/zsmoseg.json             format version
    STORE/runs/                    records of runs
    STORE/fingerprints/            fingerprints of sources that were read already
    STORE/VIDEO/video.json         source, fingerprint; VIDEO is <stem>-<16 digits of the fingerprint>
    STORE/VIDEO/probes/            times, names and sizes of the frames that are used
    STORE/VIDEO/runs/              what each run did with it
    STORE/VIDEO/STAGE/KEY/         one artifact, or STAGE/KEY.zip

Standard library only.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact, marks_in
from zsmoseg.stores.keys import FORMAT
from zsmoseg.stores.records import (
    DESCRIPTION,
    PROBES,
    RUNS,
    read_json,
    read_record,
    recall_record,
    write_json,
    write_record,
)

MARK = "zsmoseg.json"
_VIDEO = re.compile(r".+-[0-9a-f]{16}")


@dataclass(frozen=True)
class VideoFolder:
    """What a store holds of one video."""

    path: PurePath

    @property
    def description(self) -> dict[str, Any] | None:
        """``source`` and ``fingerprint``; None where that is missing or damaged."""
        return recall_record(self.path / DESCRIPTION)

    def describe(self, source: str, fingerprint: str) -> None:
        """Note where the video came from; writes only what is new or mends it."""
        content = {"source": source, "fingerprint": fingerprint}
        if content != self.description:
            write_record(self.path / DESCRIPTION, content)

    def artifact(self, stage: str, key: str) -> Artifact:
        """The artifact of a stage; it need not exist."""
        return Artifact(files.below(self.path, f"{stage}/{key}"))

    def artifacts(self) -> Iterator[Artifact]:
        """All of them."""
        for stage in files.folders(self.path):
            if stage.name not in (PROBES, RUNS):
                yield from (Artifact(path) for _, path in marks_in(stage))

    # ------------------------------------------------------------------ probes
    def probes(self) -> list[PurePath]:
        """The records of all probes."""
        return files.matching(files.below(self.path, PROBES), "*.json")

    def probe(self, frames: str) -> dict[str, Any] | None:
        """Times, names and sizes of the frames that the key ``frames`` stands for; None where nobody looked yet."""
        return recall_record(files.below(self.path, f"{PROBES}/{frames}.json"))

    def keep_probe(self, frames: str, probe: Mapping[str, Any]) -> None:
        """Keep it: it follows from the key."""
        if self.probe(frames) is None:
            write_record(files.below(self.path, f"{PROBES}/{frames}.json"), probe)


@dataclass(frozen=True)
class Store:
    """A store in the folder ``path``; ``open`` checks it, the bare constructor does not."""

    path: PurePath
    new: bool = False
    """Whether ``open`` made its folder."""

    @classmethod
    def open(cls, path: str | PurePath, create: bool) -> Store:
        """Open a store.

        Parameters
        ----------
        create
            For writing: make it where there is none, mend its mark, clear what killed runs left.

        Raises
        ------
        StoreError
            Not there, not a store, written by a newer version, or not to be written.
        """
        store = cls(files.folder(path))
        marked = store._check_mark()
        if not marked and not store._looks_like_one():
            raise StoreError(f"{path}: is not a store: it holds other things; give another folder (--store)")
        there = files.is_folder(store.path)
        if not there and not create:
            raise StoreError(f"{path}: there is no store; zsmoseg run makes one, --store names another")
        if create:
            store._make(marked)
        return replace(store, new=not there)

    def _check_mark(self) -> bool:
        """Whether the mark is there and whole."""
        version = (read_json(self.path / MARK) or {}).get("format")
        if not isinstance(version, int):
            return False
        if version != FORMAT:
            age = "a newer zsmoseg" if version > FORMAT else "an older zsmoseg"
            raise StoreError(
                f"{self.path}: is a store of format {version}, this zsmoseg writes format {FORMAT}; use {age} for "
                "it, or give another folder (--store)"
            )
        return True

    def _looks_like_one(self) -> bool:
        """Nothing there, empty, or a store that lost its mark."""
        if not files.exists(self.path):
            return True
        if not files.is_folder(self.path):
            return False
        inside = [path for path in files.inside(self.path) if path.name != MARK and path.suffix != ".tmp"]
        runs = bool(files.matching(self.runs, "*.json"))
        return not inside or runs or any(files.exists(path / DESCRIPTION) for path in inside)

    def _make(self, marked: bool) -> None:
        try:
            if not marked:
                self.mark()
            for folder in (self.path, self.runs, files.below(self.path, "fingerprints")):
                for leftover in files.leftovers(folder, everywhere=False):
                    files.remove(leftover)
        except OSError as error:
            raise StoreError(
                f"{self.path}: cannot be written ({error.strerror}); mend that or give another folder (--store)"
            ) from error

    def unmake(self, run: str) -> None:
        """Remove a store that was made for the refused ``run`` alone; it stays as soon as anything else is in it."""
        inside = {path.name for path in files.inside(self.path)}
        others = [path for path in files.matching(self.runs, "*.json") if path.stem != run]
        if self.new and not others and inside <= {MARK, self.runs.name, "fingerprints"}:
            files.remove(self.path)

    def mark(self) -> None:
        """Say again that it is a store: a run that was refused may have unmade it before this one had anything in it."""
        if not self._check_mark():
            write_json(self.path / MARK, {"format": FORMAT})

    @property
    def runs(self) -> PurePath:
        """Where the records of runs are."""
        return files.below(self.path, "runs")

    # ------------------------------------------------------------------ videos
    def videos(self) -> list[str]:
        """The ids of the videos."""
        return [folder.name for folder in files.folders(self.path) if _VIDEO.fullmatch(folder.name)]

    def video(self, video: str) -> VideoFolder:
        """The folder of a video; it need not exist."""
        return VideoFolder(files.below(self.path, video, one=True))

    def video_id(self, name: str, fingerprint: str) -> str:
        """The id of a video: that of the folder it has, whatever its name was then, else a new one."""
        end = f"-{fingerprint[:16]}"
        if not _VIDEO.fullmatch(f"x{end}"):
            raise ValueError(f"{fingerprint}: no fingerprint, it needs 16 hexadecimal digits")
        new = re.sub(r"[^\w.-]+", "_", name).strip("._")[:80] or "video"
        if files.listing(self.path / (new + end)):  # which is asked for anyway, once for all
            return new + end
        # a pattern, not all videos: of ten thousand that would take longer than a small video
        known = (path for path in files.matching(self.path, f"*{end}") if files.is_folder(path))
        return next((path.name for path in known if _VIDEO.fullmatch(path.name)), new + end)

    def artifact(self, video: str, stage: str, key: str) -> Artifact:
        """The artifact of a stage of a video; it need not exist."""
        return self.video(video).artifact(stage, key)

    def artifacts(self) -> Iterator[Artifact]:
        """All artifacts."""
        for video in self.videos():
            yield from self.video(video).artifacts()

    def describe_video(self, video: str, source: str, fingerprint: str) -> None:
        """See ``VideoFolder.describe``."""
        self.video(video).describe(source, fingerprint)

    # ------------------------------------------------------------------ fingerprints
    def fingerprint(self, source: str, method: str) -> str:
        """The fingerprint of a source: the one known here if no file was touched since, else computed."""
        from zsmoseg.video.sources import fingerprint, stat_signature

        return self.fingerprint_of(f"{method} {stat_signature(source)}", lambda: fingerprint(source, method))

    def fingerprint_of(self, signature: str, compute: Callable[[], str]) -> str:
        """What ``compute`` gives, remembered under ``signature``: paths, sizes, times of change, inodes."""
        return str(self.remembered(signature, lambda: {"fingerprint": compute()})["fingerprint"])

    def remembered(self, signature: str, compute: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
        """What ``compute`` gives, kept under ``signature``; it has the fingerprint of the source, by which it is found to be garbage.

        Damaged entries are computed again. Nothing is kept where no store was made yet (``--dry-run``).
        """
        name = hashlib.blake2b(signature.encode(), digest_size=10).hexdigest()
        path = files.below(self.path, f"fingerprints/{name}.json")
        known = read_record(path)
        if known is not None:
            return known
        found = compute()
        if files.exists(self.path / MARK):
            write_record(path, found)
        return found
