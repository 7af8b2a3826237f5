"""Which dataset a folder holds, told from its layout."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from zsmoseg.datasets.fbms59 import fbms_sequence, is_fbms
from zsmoseg.datasets.label_folders import label_files, layered_sequence, mask_sequence
from zsmoseg.datasets.point_tracks import holds_tracks
from zsmoseg.datasets.published import sequence_lists
from zsmoseg.datasets.sequence import Points, Truth
from zsmoseg.errors import DatasetError
from zsmoseg.metrics.protocols import protocol_named

RESOLUTIONS = ("480p", "Full-Resolution", "1080p")
SPLITS = ("", "train", "valid")


@dataclass(frozen=True)
class Dataset:
    """A dataset on disk: what it is called, and the folder or file of each sequence.

    Attributes
    ----------
    kind : how a sequence is read.
    images : the folder that holds a folder of frames for each sequence, or ``None``.
    """

    name: str
    path: Path
    kind: Literal["masks", "layers", "fbms", "points"]
    places: dict[str, Path]
    images: Path | None = None

    @property
    def truth_kind(self) -> Literal["masks", "points"]:
        """What the truth is made of: label images, or labelled track points."""
        return "points" if self.kind == "points" else "masks"

    def truth(self, sequence: str) -> Truth | Points:
        """The truth of one sequence, checked."""
        place = self.places[sequence]
        images = None if self.images is None else self.images / sequence
        if self.kind == "points":
            return Points(sequence, place)
        if self.kind == "fbms":
            return fbms_sequence(place)
        return (layered_sequence if self.kind == "layers" else mask_sequence)(place, images)


def open_dataset(path: Path, protocol: str = "moving") -> Dataset:
    """Recognise the dataset in a folder: its root, or the folder of its annotations.

    Parameters
    ----------
    protocol : DAVIS has annotations of its own for some.

    Raises
    ------
    DatasetError
        Not a folder, empty, or of no known layout.
    """
    if not path.is_dir():
        raise DatasetError(f"{path}: is no folder; --truth takes the root of a dataset or its annotations")
    if not any(path.iterdir()):
        raise DatasetError(f"{path}: is empty")
    found = _points(path) or _fbms(path) or _segtrack(path) or _annotations(path, protocol) or _plain(path)
    if found is None and label_files(path):
        raise DatasetError(
            f"{path}: holds masks itself; give the folder above it, with one folder a sequence"
        )
    if found is None:
        raise DatasetError(
            f"{path}: has no layout that is known: DAVIS or YouTube-VOS (Annotations), FBMS-59 (GroundTruth/*.dat), "
            "SegTrack v2 (GroundTruth), KT3DMoSeg (.npz, .mat), or a folder of PNG for each sequence"
        )
    return found


def _points(path: Path) -> Dataset | None:
    folder = path / "Data" if (path / "Data").is_dir() else path
    files = sorted(
        f for f in folder.iterdir() if f.suffix == ".mat" or (f.suffix == ".npz" and holds_tracks(f))
    )
    if not files:
        return None
    places = {file.stem: file for file in files}
    known = {name.lower() for name in sequence_lists()["kt3dmoseg"]}
    name = "KT3DMoSeg" if {n.lower() for n in places} <= known else "point tracks"
    return Dataset(name, path, "points", places)


def _fbms(path: Path) -> Dataset | None:
    sets = [path / name for name in ("Testset", "Trainingset") if (path / name).is_dir()] or [path]
    places = {folder.name: folder for group in sets for folder in _folders(group) if is_fbms(folder)}
    return Dataset("FBMS-59", path, "fbms", places) if places else None


def _segtrack(path: Path) -> Dataset | None:
    ground = path / "GroundTruth"
    if not ground.is_dir():
        return None
    places = {f.name: f for f in _folders(ground) if label_files(f) or any(map(label_files, _folders(f)))}
    return Dataset("SegTrack v2", path, "layers", places, path / "JPEGImages") if places else None


def _annotations(path: Path, protocol: str) -> Dataset | None:
    """DAVIS and YouTube-VOS: ``Annotations``, in DAVIS with the resolution below."""
    folder = next((f for f in _annotation_folders(path, protocol) if _with_masks(f)), None)
    if folder is None:
        return None
    parts = [("JPEGImages" if p.startswith("Annotations") else p) for p in folder.parts]
    places = _with_masks(folder)
    split = folder.parent.name in SPLITS[1:]
    name = "YouTube-VOS" if split or _hexadecimal(places) else "DAVIS"
    return Dataset(name, path, "masks", places, Path(*parts))


def _annotation_folders(path: Path, protocol: str) -> Iterable[Path]:
    for kind in dict.fromkeys((protocol_named(protocol).annotations, "Annotations")):
        for split in SPLITS:
            base = path / split / kind
            yield from (base / name for name in (*RESOLUTIONS, ""))
    if path.name.startswith("Annotations"):
        yield from (path / name for name in (*RESOLUTIONS, ""))
    elif path.parent.name.startswith("Annotations"):
        yield path


def _plain(path: Path) -> Dataset | None:
    places = _with_masks(path)
    if not places:
        return None
    lists = sequence_lists()
    davis = {n for key, names in lists.items() if key.startswith("davis") for n in names}
    name = "YouTube-VOS" if _hexadecimal(places) else "DAVIS" if set(places) <= davis else "folders of masks"
    return Dataset(name, path, "masks", places)


def _with_masks(folder: Path) -> dict[str, Path]:
    """The folders in ``folder`` that hold label images."""
    return {inner.name: inner for inner in _folders(folder) if label_files(inner)}


def _folders(path: Path) -> list[Path]:
    return sorted(p for p in path.iterdir() if p.is_dir() and p.name[0] != ".") if path.is_dir() else []


def _hexadecimal(names: Iterable[str]) -> bool:
    """Names as YouTube-VOS gives them."""
    return all(re.fullmatch(r"[0-9a-f]{10}", name) for name in names)
