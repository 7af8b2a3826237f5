"""Export of cues on the working grid: a folder a video and cue, a file a frame or pair."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import OutputError
from zsmoseg.formats.depth import encode_depth
from zsmoseg.formats.flow_files import encode_kitti, write_flo
from zsmoseg.formats.names import SIDES
from zsmoseg.stores import files
from zsmoseg.stores.reader import read_video
from zsmoseg.workflows.export.registry import Choice
from zsmoseg.workflows.result import BLOCK, Result

WriteFlow = Callable[[Path, NDArray[Any], str], None]
"""Writes (2, H, W) flow; the path, and where it stands, for errors."""


def write_flo_files(result: Result, path: Path, choice: Choice) -> None:
    """Flow as Middlebury has it."""

    def write(file: Path, flow: NDArray[Any], where: str) -> None:
        del where  # everything fits
        write_flo(file, flow)

    _write_flow(result, path, ".flo", write)


def write_arrays(result: Result, path: Path, choice: Choice) -> None:
    """Flow (2, H, W) px, or relative inverse depth (H, W), as .npy."""

    def write(file: Path, flow: NDArray[Any], where: str) -> None:
        del where  # everything fits
        np.save(file, flow)

    if choice.cues == ("flow",):
        return _write_flow(result, path, ".npy", write)
    path.mkdir(parents=True)
    for name, depth in _rows(result, "depth", "inverse_depth"):
        np.save(_file(path, name, ".npy"), depth.astype(np.float32))
    return None


def write_images(result: Result, path: Path, choice: Choice) -> None:
    """Flow as KITTI has it, or relative inverse depth in 16 bits: the largest of the video is 65535."""

    def write(file: Path, flow: NDArray[Any], where: str) -> None:
        files.write(file, encode_kitti(flow, where))

    if choice.cues == ("flow",):
        return _write_flow(result, path, ".png", write)
    rows = _rows(result, "depth", "inverse_depth")
    largest = max(float(np.nanmax(depth, initial=0)) for _, depth in rows)
    for name, depth in _rows(result, "depth", "inverse_depth"):
        files.write(_file(path, name, ".png"), encode_depth(depth.astype(np.float32), largest))
    return None


def _write_flow(result: Result, path: Path, ending: str, write: WriteFlow) -> None:
    """``forward`` and ``backward``, a file a pair, called like its first frame."""
    for side in SIDES:
        (path / side).mkdir(parents=True)
        for name, flow in _rows(result, "flow", side):
            write(_file(path / side, name, ending), flow, f"{result.name}, frame {name}")


def _file(folder: Path, name: str, ending: str) -> Path:
    """The file of a frame: its name comes from a record."""
    return files.below(folder, f"{name}{ending}", OutputError, one=True)


def _rows(result: Result, stage: str, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Names of frames and rows of a video array, read in blocks."""
    artifact = result.artifact(stage)
    names, count = result.probe.names, artifact.shape(name)[0]
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        yield from zip(names[start:stop], read_video(artifact, name, start, stop), strict=True)
