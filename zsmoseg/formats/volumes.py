"""Masks in .npz files: a volume of ids, detections of single frames, proposals of one frame a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats.binary import refuse_binary
from zsmoseg.formats.names import others
from zsmoseg.formats.npy import Rows, load, only_key
from zsmoseg.formats.overlaps import FrameMasks, MaskSource, as_ids, refuse_many, stack, text
from zsmoseg.video.bounds import TooLarge, check_size

PREFIX = "proposals_"
"""Of files with the proposals of one frame."""


class IdVolume(MaskSource):
    """One array (T, H, W) of ids: the only one of an .npz, or an .npy."""

    def __init__(self, path: Path) -> None:
        detections = " (frame, y, x) of ids, or frame, score, packed and size of detections"
        self._rows = Rows(path, only_key(path, detections))
        shape = self._rows.shape
        if len(shape) != 3 or 0 in shape:
            raise FormatError(f"{path}: the array is {text(shape)}; ids are (frame, y, x)")
        super().__init__(path, None, shape[0], (shape[1], shape[2]), ids=True)
        refuse_binary((self._where(t), self._read(t).label) for t in range(self.count))

    def _where(self, index: int) -> str:
        return f"{self.path}, frame {index}"

    def _read(self, index: int) -> FrameMasks:
        return FrameMasks(as_ids(self._rows.read(index), self.size, self._where(index)))


class Detections(MaskSource):
    """Masks with scores of all frames of a video in one .npz: ``frame``, ``score``, ``packed``, ``size``."""

    KEYS = frozenset({"frame", "score", "packed", "size"})

    def __init__(self, path: Path) -> None:
        found = load(path)
        self._frame, self._score, self._packed = found["frame"], found["score"], found["packed"]
        if len({len(self._frame), len(self._score), len(self._packed)}) != 1 or found["size"].shape != (2,):
            raise FormatError(f"{path}: frame, score and packed must have one entry for each mask, size two")
        if self._frame.dtype.kind not in "ui" or int(self._frame.min(initial=0)) < 0:
            raise FormatError(f"{path}: frame must hold the indices of frames, counted from 0")
        unscored = np.flatnonzero(~np.isfinite(self._score))
        if len(unscored):
            raise FormatError(
                f"{path}: the mask of frame {self._frame[unscored[0]]} has the score {self._score[unscored[0]]}; "
                "scores must be numbers, they say which mask is on top"
            )
        height, width = _size(path, found["size"])
        super().__init__(path, None, int(self._frame.max(initial=-1)) + 1, (height, width), ids=False)

    @property
    def entries(self) -> range:
        """After the last frame with a detection there may be others."""
        return range(self.count)

    def _read(self, index: int) -> FrameMasks:
        own = np.flatnonzero(self._frame == index)
        where = f"{self.path}, frame {index}"
        refuse_many(len(own), self.size, where)
        masks = unpack(self._packed[own], self.size, where)
        return stack(list(masks), self.size, scores=self._score[own].tolist())


class ProposalFolder(MaskSource):
    """Files ``proposals_<frame>.npz``: ``packed``, ``shape`` (masks, H, W) and, if known, ``score``."""

    def __init__(self, folder: Path, files: list[Path]) -> None:
        size = self._load(files[0])[1]
        super().__init__(folder, [f.stem.removeprefix(PREFIX) for f in files], len(files), size, ids=False)
        self._files = files
        self.left_out += others(folder, files)

    @staticmethod
    def _load(file: Path) -> tuple[dict[str, NDArray[Any]], tuple[int, int]]:
        found = load(file)
        if not {"packed", "shape"} <= found.keys() or found["shape"].shape != (3,):
            raise FormatError(
                f"{file}: holds {', '.join(found)}; expected packed, shape (masks, H, W) and score"
            )
        return found, _size(file, found["shape"][1:])

    def _read(self, index: int) -> FrameMasks:
        file = self._files[index]
        found, size = self._load(file)
        if size != self.size:
            raise FormatError(
                f"{file}: is {text(size)}, {self._files[0].name} {text(self.size)}; give all in one size"
            )
        refuse_many(len(found["packed"]), size, str(file))
        masks, score = unpack(found["packed"], size, str(file)), found.get("score")
        if score is not None and score.shape != (len(masks),):
            raise FormatError(f"{file}: has {len(masks)} masks and {score.size} scores; give one for each")
        return stack(list(masks), size, scores=None if score is None else score.tolist())


def _size(path: Path, sides: NDArray[Any]) -> tuple[int, int]:
    """(H, W) as a file states it."""
    if sides.dtype.kind not in "ui":
        raise FormatError(f"{path}: states a size of {sides.dtype}; height and width are whole numbers")
    height, width = map(int, sides)
    try:
        check_size(height, width)
    except TooLarge as error:
        raise FormatError(f"{path}: {error}; write the size of the masks") from error
    return height, width


def unpack(packed: NDArray[Any], size: tuple[int, int], where: str) -> NDArray[np.bool_]:
    """Masks (K, H, W) from rows of ``numpy.packbits``; ``where`` begins the error."""
    count = size[0] * size[1]
    if packed.ndim != 2 or packed.dtype != np.uint8 or packed.shape[1] != (count + 7) // 8:
        raise FormatError(
            f"{where}: rows of {packed.shape[-1]} bytes cannot be masks of {text(size)}; pack each mask by itself"
        )
    return np.unpackbits(packed, axis=1, count=count).reshape(-1, *size).astype(bool)
