"""Depth, or inverse depth, of one video: png, .npy, .npz, .exr; a file a frame, or one for all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats.exr_head import check_exr
from zsmoseg.formats.label_images import one_channel, read_values
from zsmoseg.formats.names import frame_files, others
from zsmoseg.formats.npy import Array, Rows, load, only_key
from zsmoseg.formats.overlaps import index_of, text

Map = NDArray[np.float32]
Kind = Literal["depth", "inverse-depth", "disparity"]
"""What the numbers of a depth map are."""
HIGHEST = 65535
"""Of 16 bits."""


class DepthSource:
    """The depth maps of one video.

    Parameters
    ----------
    path
        What errors begin with.
    frames
        Names of the frames; None where the file knows only their order.
    count
        Number of maps.
    reader
        A function from the index of a map to the map and where it stands.
    left_out
        What of the folder is no depth: how many of what, in words.
    """

    def __init__(
        self,
        path: Path,
        frames: list[str] | None,
        count: int,
        reader: Callable[[int], tuple[Map, str]],
        left_out: Counter[str] | None = None,
    ) -> None:
        self.path, self.frames, self.count, self._reader = path, frames, count, reader
        self.left_out = left_out or Counter()
        self._size: tuple[int, ...] | None = None

    def read(self, entry: int | str) -> Map:
        """(H, W) float32 as stored.

        Raises
        ------
        FormatError
            If the file is damaged, no map of numbers, of another size than the first, or says nothing.
        """
        index = entry if isinstance(entry, int) else index_of(self.frames, entry, self.path)
        if self._size is None and index > 0:
            self._size = self._reader(0)[0].shape
        depth, where = self._reader(index)
        self._size = self._size or depth.shape
        if depth.shape != self._size:
            raise FormatError(
                f"{where}: is {text(depth.shape)}, the first {text(self._size)}; give all in one size"
            )
        return depth


def open_depth(path: str | Path) -> DepthSource:
    """Open the depth of one video.

    Parameters
    ----------
    path
        A folder with a grey .png (16 bits; 8 are read too), .npy, .npz or .exr (H, W) for every frame; or one
        .npy or .npz (frames, H, W).

    Raises
    ------
    FormatError
        If it is none of these.
    """
    path = Path(path)
    if path.is_dir():
        files = frame_files(path, READERS)
        if not files:
            raise FormatError(f"{path}: holds no depth; give {', '.join(READERS)} named like the frames")
        return DepthSource(
            path,
            [f.stem for f in files],
            len(files),
            lambda i: (read_depth(files[i]), str(files[i])),
            others(path, files),
        )
    if not path.is_file() or path.suffix.lower() not in (".npy", ".npz"):
        raise FormatError(f"{path}: is no depth; give a folder of {', '.join(READERS)}, or one .npy or .npz")
    rows = Rows(path, only_key(path))
    if len(rows.shape) != 3:
        raise FormatError(f"{path}: is {text(rows.shape)}; the depth of a video is (frames, y, x)")

    def read(index: int) -> tuple[Map, str]:
        where = f"{path}, frame {index}"
        return as_depth(rows.read(index), where), where

    return DepthSource(path, None, rows.shape[0], read)


def read_depth(path: Path) -> Map:
    """One file of depth, (H, W).

    Raises
    ------
    FormatError
        If it cannot be used.
    """
    return as_depth(READERS[path.suffix.lower()](path), str(path))


def _read_png(path: Path) -> Array:
    values = one_channel(read_values(path, shown=True))
    if values is None:
        raise FormatError(
            f"{path}: is in colour, depth painted for the eye; give the depth itself, one number a pixel: a grey png of "
            "16 bits, .npy, .npz or .exr"
        )
    return values


def _read_array(path: Path) -> Array:
    return load(path)[only_key(path)]


def _read_exr(path: Path) -> Array:
    try:
        check_exr(path)
    except (OSError, ValueError) as error:
        raise FormatError(f"{path}: cannot be read ({error}); convert it to .npy") from error
    try:
        found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        found = None
    if found is None:
        raise FormatError(
            f"{path}: OpenCV cannot read it (damaged, or built without OpenEXR, or OPENCV_IO_ENABLE_OPENEXR=1 "
            "is not set); convert it to .npy"
        )
    alike = found.ndim == 3 and all(np.array_equal(found[..., 0], c, True) for c in np.moveaxis(found, 2, 0))
    return np.asarray(found[..., 0] if alike else found)


READERS: dict[str, Callable[[Path], Array]] = {
    ".png": _read_png,
    ".npy": _read_array,
    ".npz": _read_array,
    ".exr": _read_exr,
}


def as_depth(values: Array, where: str) -> Map:
    """A map (H, W) as float32; ``where`` begins the errors."""
    if values.ndim != 2 or not values.size or values.dtype.kind not in "uif":
        raise FormatError(
            f"{where}: is {text(values.shape)} {values.dtype}; depth is one number a pixel, (y, x)"
        )
    with np.errstate(over="ignore"):
        found = values.astype(np.float32)
    if not np.isfinite(found).any():
        raise FormatError(
            f"{where}: holds no finite number of 32 bits; every frame needs depth: make it anew"
        )
    return found


def inverse_depth(values: NDArray[Any], kind: Kind) -> Map:
    """Relative inverse depth (H, W), near is large; NaN where unknown.

    Parameters
    ----------
    values : (H, W) as stored.
    kind : ``depth``: far is large; 0 (what has no inverse in float32), less and NaN are unknown, infinitely far is 0. ``inverse-depth``: near is
        large; NaN and infinity are unknown. ``disparity``: the same, and 0 and less are unknown, as in stereo.
    """
    given = np.asarray(values, np.float32)
    if kind == "inverse-depth":
        return np.where(np.isfinite(given), given, np.float32(np.nan))
    if kind == "disparity":
        return np.where(np.isfinite(given) & (given > 0), given, np.float32(np.nan))
    return np.divide(1, given, out=np.full_like(given, np.nan), where=given > 1 / np.finfo(np.float32).max)


def encode_depth(inverse: NDArray[Any], largest: float) -> bytes:
    """A 16-bit png of relative inverse depth (H, W): ``largest`` becomes 65535, unknown and negative ones 0."""
    scaled = np.nan_to_num(inverse, nan=0.0) * (HIGHEST / largest if largest > 0 else 0.0)
    return cv2.imencode(".png", np.rint(np.clip(scaled, 0, HIGHEST)).astype(np.uint16))[1].tobytes()
