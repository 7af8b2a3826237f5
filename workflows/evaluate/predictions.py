"""Masks to be scored: a store, output folders of ``zsmoseg run``, folders of label images, .npz or .npy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from zsmoseg.datasets import Truth
from zsmoseg.datasets.label_folders import label_files
from zsmoseg.errors import FormatError, SettingsError, StoreError
from zsmoseg.formats.label_images import read_labels
from zsmoseg.remote.url import URL, place
from zsmoseg.stores.location import MARK, Store
from zsmoseg.workflows.evaluate.array_frames import ARRAYS, Labels, Read, array_rows, open_volume, reader

Kind = Literal["group", "instance"]

FOLDERS = {"group": "masks", "instance": "objects"}


@dataclass(frozen=True)
class Prediction:
    """One method's masks of all sequences.

    Where zsmoseg made them ``kind`` says motion groups or single instances, and ``run`` which run of a store.
    """

    name: str
    path: Path | URL
    kind: Kind = "group"
    run: str | None = None

    def check(self, truth: Truth, inner: bool) -> None:
        """Raise ``FormatError`` if masks of the sequence or of one of its scored frames are missing."""
        place = self._place(truth.name)
        if place is not None and place.is_dir():
            _files(place, truth.scored(inner).frames)

    def open(self, truth: Truth, inner: bool) -> Read:
        """Ready to read the scored frames; fastest in ascending order.

        Raises
        ------
        FormatError
            Missing masks, a file that holds something else.
        """
        place, frames = self._place(truth.name), truth.scored(inner).frames
        if place is None:
            return self._stored(truth.name, frames)
        if place.is_dir():
            files = _files(place, frames)
            return lambda index: (str(files[index]), read_labels(files[index]))
        volume = open_volume(place)
        rows = array_rows(place, truth.numbers, volume.shape[0])
        return reader(volume, rows[1:-1] if inner else rows)

    def in_order(self, sequence: str, count: int) -> Read:
        """Ready to read all ``count`` frames of a video by their place.

        Raises
        ------
        FormatError
            Missing masks, or another number of them.
        """
        place = self._place(sequence)
        if place is None:
            from zsmoseg.workflows.result import open_store

            names = open_store(self.path).get(sequence, self.run).probe.names
            found, read = len(names), self._stored(sequence, names)
        elif place.is_dir():
            files = label_files(place)
            found, read = len(files), lambda index: (str(files[index]), read_labels(files[index]))
        else:
            volume = open_volume(place)
            found, read = volume.shape[0], reader(volume, range(volume.shape[0]))
        if found != count:
            raise FormatError(
                f"{place or self.path}: has {found} masks of {sequence!r}, its tracks {count} frames"
            )
        return read

    def _place(self, sequence: str) -> Path | None:
        """The folder or file with the masks of a sequence, ``None`` for a store."""
        if isinstance(self.path, URL) or (self.path / MARK).is_file():
            from zsmoseg.workflows.result import open_store

            if sequence not in list(open_store(self.path)):
                raise FormatError(
                    f"{self.path}: the store has no video {sequence!r}, a sequence of the truth"
                )
            return None
        folder = self.path / sequence
        inner = folder / FOLDERS[self.kind]
        places = [inner, folder, *(self.path / f"{sequence}{suffix}" for suffix in ARRAYS)]
        place = next((p for p in places if p.is_file() or (p.is_dir() and label_files(p))), None)
        if place is None:
            raise FormatError(
                f"{self.path}: has no masks of the sequence {sequence!r} (expected {sequence}/*.png, "
                f"{sequence}/{FOLDERS[self.kind]}/*.png, {sequence}.npz or .npy); --sequences leaves sequences out"
            )
        return place

    def _stored(self, video: str, frames: Sequence[str]) -> Read:
        """Masks of a finished run, some frames at once."""
        from zsmoseg.workflows.result import BLOCK, open_store

        result = open_store(self.path).get(video, self.run)
        place = {name: index for index, name in enumerate(result.probe.names)}
        missing = next((name for name in frames if name not in place), None)
        if missing is not None:
            raise FormatError(f"{self.path}: the video {video!r} has no frame {missing}, which is annotated")
        masks = result.masks(self.kind)
        block: dict[int, Labels] = {}

        def read(index: int) -> tuple[str, Labels]:
            number, inside = divmod(place[frames[index]], BLOCK)
            if number not in block:
                block.clear()
                try:
                    block[number] = masks[number * BLOCK : (number + 1) * BLOCK].values
                except (OSError, ValueError) as error:
                    raise StoreError(f"{self.path}: masks of {video!r} cannot be read ({error})") from error
            return f"{self.path}: {video}, frame {frames[index]}", block[number][inside]

        return read


def named_predictions(arguments: Sequence[str], kind: Kind) -> list[Prediction]:
    """The predictions that ``NAME=PATH`` or ``PATH`` mean; without a name, the shortest end of the path that is unique.

    Raises
    ------
    FormatError
        A path that is no folder or empty.
    SettingsError
        Two with the same name.
    """
    given = [_split(argument) for argument in arguments]
    for _, path in given:
        if isinstance(path, URL):
            Store.open(path, create=False)
            continue
        if not path.is_dir():
            raise FormatError(f"{path}: is no folder of masks and no store")
        if not any(path.iterdir()):
            raise FormatError(f"{path}: is empty")
    ends = [_parts(path) for name, path in given if not name]
    names = [name or _shortest_end(_parts(path), ends) for name, path in given]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise SettingsError(f"two predictions are called {twice!r}; name them NAME=PATH")
    return [Prediction(name, path, kind) for name, (_, path) in zip(names, given, strict=True)]


def _split(argument: str) -> tuple[str, Path | URL]:
    name, sign, path = argument.partition("=")
    whole = not sign or "/" in name or Path(argument).exists()
    return ("", place(argument)) if whole else (name, place(path))


def _parts(path: Path | URL) -> tuple[str, ...]:
    return path.parts if isinstance(path, URL) else path.resolve().parts


def _shortest_end(parts: tuple[str, ...], others: Sequence[tuple[str, ...]]) -> str:
    length = next(
        (n for n in range(1, len(parts)) if sum(o[-n:] == parts[-n:] for o in others) == 1), len(parts)
    )
    return str(Path(*parts[-length:]))


def _files(folder: Path, frames: Sequence[str]) -> list[Path]:
    """The mask of each annotated frame."""
    files = {path.stem: path for path in label_files(folder)}
    missing = next((name for name in frames if name not in files), None)
    if missing is not None:
        names = list(files)
        raise FormatError(
            f"{folder}: has no mask of the annotated frame {missing}; its {len(names)} masks are called "
            f"{names[0]} to {names[-1]}"
        )
    return [files[name] for name in frames]
