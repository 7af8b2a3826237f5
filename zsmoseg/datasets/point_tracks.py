"""KT3DMoSeg and data sets like it: point tracks with their motion group, as .npz or the original .mat."""

from __future__ import annotations

import subprocess
import sys
from io import BytesIO
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


_READER = """
import sys, numpy, scipy.io
try:
    from resource import RLIMIT_AS, getrlimit, setrlimit
    setrlimit(RLIMIT_AS, (1 << 32, getrlimit(RLIMIT_AS)[1]))
except (ImportError, ValueError, OSError):
    pass  # Windows has none, others have a lower one
try:
    data = scipy.io.loadmat(sys.argv[1], simplify_cells=True)["Data"]
    found = dict(points=data["ySparse"], visible=data["visibleSparse"], label=data["GtLabel"])
    numpy.savez(sys.stdout.buffer, **found)
except Exception as error:
    sys.exit(str(error) or type(error).__name__)
"""


def _npz(path: Path) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    arrays = load(path)
    return arrays["points"], arrays["visible"], arrays["label"]


def _mat(path: Path) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """``Data.ySparse`` (3, tracks, frames), ``Data.visibleSparse`` (tracks, frames), ``Data.GtLabel``.

    SciPy's reader goes by the sizes in the file, and a damaged one can end the process: it has one of its own.
    """
    words = [sys.executable, "-P", "-c", _READER, str(path.absolute())]
    done = subprocess.run(words, capture_output=True, check=False)
    if done.returncode:
        told = done.stderr.decode(errors="replace").strip().splitlines() or ["its reader died"]
        raise ValueError(told[-1])
    with np.load(BytesIO(done.stdout), allow_pickle=False) as found:
        return found["points"][:2].transpose(1, 2, 0), found["visible"], found["label"].ravel()
