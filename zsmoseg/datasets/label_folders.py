"""Sequences whose truth is one label image a frame: DAVIS, YouTube-VOS, SegTrack v2, plain folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from zsmoseg.datasets.sequence import Truth, numbered
from zsmoseg.errors import DatasetError
from zsmoseg.formats.names import frame_number

SUFFIXES = (".png", ".bmp", ".tif", ".tiff")
"""Label images; JPEG does not keep ids."""


def label_files(folder: Path) -> list[Path]:
    """The label images in a folder, by frame number, then by name."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.name[0] != "."]
    return sorted(found, key=lambda path: (frame_number(path.stem) or 0, path.name))


def mask_sequence(folder: Path, images: Path | None = None) -> Truth:
    """The truth in a folder of label images.

    Parameters
    ----------
    images : the folder of the frames, if there is one: every annotation must belong to one of them.

    Raises
    ------
    DatasetError
        No annotation, names without or with the same numbers, an annotation without a frame.
    """
    files = label_files(folder)
    if not files:
        raise DatasetError(f"{folder}: holds no annotation (PNG)")
    names = [path.stem for path in files]
    numbers = numbered(names, folder)
    note = "" if images is None or not images.is_dir() else _compare(folder, files, images)
    return Truth(folder.name, tuple(names), numbers, tuple((path,) for path in files), note)


def layered_sequence(folder: Path, images: Path | None = None) -> Truth:
    """SegTrack v2: a folder of binary masks for each object, or one folder of masks where there is one object."""
    layers = sorted(path for path in folder.iterdir() if path.is_dir())
    if not layers:
        return mask_sequence(folder, images)
    parts = [mask_sequence(layer, images) for layer in layers]
    for part, layer in zip(parts, layers, strict=True):
        if part.frames != parts[0].frames:
            name = sorted(set(part.frames) ^ set(parts[0].frames))[0]
            raise DatasetError(f"{layer}: frame {name} is not annotated for every object of {folder.name}")
    files = zip(*(part.files for part in parts), strict=True)
    return Truth(
        folder.name,
        parts[0].frames,
        parts[0].numbers,
        tuple(tuple(layer[0] for layer in frame) for frame in files),
        parts[0].note,
    )


def _compare(folder: Path, files: Sequence[Path], images: Path) -> str:
    """What is annotated of a video."""
    frames = {path.stem for path in images.iterdir() if path.name[0] != "."}
    foreign = next((path for path in files if path.stem not in frames), None)
    if foreign is not None:
        raise DatasetError(f"{foreign}: annotates a frame that is not in {images}")
    return "" if len(files) == len(frames) else "not every frame is annotated"
