"""KT3DMoSeg and data sets like it: point tracks with their motion group, as .npz or the original .mat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import DatasetError, FormatError
from zsmoseg.formats.npy import keys, load
from zsmoseg.metrics.clips import PointTracks

ARRAYS = ("points", "visible", "label")


def holds_tracks(path: Path) -> bool:
    """Whether an .npz holds point tracks."""
    try:
        return set(ARRAYS) <= set(keys(path))
    except FormatError:
        return False


def read_tracks(path: Path) -> PointTracks:
    """Read the tracks of one clip.

    Raises
    ------
    DatasetError
        Not readable, without the arrays, or with arrays that do not fit each other.
    """
    try:
        points, visible, label = _mat(path) if path.suffix == ".mat" else _npz(path)
    except (FormatError, OSError, KeyError, IndexError, TypeError, ValueError) as error:
        why = str(error).removeprefix(f"{path}: ")
        raise DatasetError(f"{path}: cannot be read as point tracks ({why})") from error
    if (
        points.ndim != 3
        or points.shape[2] != 2
        or points.shape[:2] != visible.shape
        or len(label) != len(points)
    ):
        raise DatasetError(
            f"{path}: points {points.shape}, visible {visible.shape} and label {label.shape} do not fit each other"
        )
    return PointTracks(points.astype(np.float64), visible.astype(np.bool_), label.astype(np.int64))


def _npz(path: Path) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    arrays = load(path)
    return arrays["points"], arrays["visible"], arrays["label"]


def _mat(path: Path) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """``Data.ySparse`` (3, tracks, frames), ``Data.visibleSparse`` (tracks, frames), ``Data.GtLabel``."""
    from scipy.io import loadmat

    try:
        data = loadmat(path, simplify_cells=True)["Data"]
    except Exception as error:  # its reader raises whatever it stumbles over
        raise ValueError(str(error) or type(error).__name__) from error
    points = np.asarray(data["ySparse"])[:2].transpose(1, 2, 0)
    return points, np.asarray(data["visibleSparse"]), np.asarray(data["GtLabel"]).ravel()
