"""What writes one file or folder of an export: a function from a result, a path and the choice a format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.formats.coco import encode_coco
from zsmoseg.formats.depth import encode_depth
from zsmoseg.formats.flow_files import encode_kitti, write_flo
from zsmoseg.formats.keep import encode_keep
from zsmoseg.formats.mots import encode_mots
from zsmoseg.formats.names import SIDES
from zsmoseg.formats.npy import write_volume
from zsmoseg.formats.ytvis import encode_ytvis
from zsmoseg.masks import encode_png
from zsmoseg.stores import files
from zsmoseg.workflows.export.copying import write_netcdf, write_zarr
from zsmoseg.workflows.export.painting import image_names, number_tables, painted
from zsmoseg.workflows.result import BLOCK, Result


@dataclass(frozen=True)
class Choice:
    """What to export."""

    format: str
    what: str
    when: Literal["ever", "now"]
    dilate: int
    cues: tuple[str, ...]


# ------------------------------------------------------------------ ids
def _write_davis(result: Result, path: Path, choice: Choice) -> None:
    for name, ids in zip(result.probe.names, painted(result, choice.what, choice.when), strict=True):
        files.write(path / f"{name}.png", encode_png(ids))


def _write_npz(result: Result, path: Path, choice: Choice) -> None:
    probe = result.probe
    shape = (len(probe.times), probe.height, probe.width)
    write_volume(path, "segmentation", painted(result, choice.what, choice.when), shape, "uint16")


def _write_coco(result: Result, path: Path, choice: Choice) -> None:
    size = result.probe.height, result.probe.width
    files.write(path, encode_coco(image_names(result, True), painted(result, choice.what, choice.when), size))


def _write_ytvis(result: Result, path: Path, choice: Choice) -> None:
    size = result.probe.height, result.probe.width
    files.write(
        path,
        encode_ytvis(result.name, image_names(result, True), painted(result, choice.what, choice.when), size),
    )


def _write_mots(result: Result, path: Path, choice: Choice) -> None:
    files.write(path, encode_mots(painted(result, choice.what, choice.when)))


# ------------------------------------------------------------------ pixels to keep
def _write_colmap(result: Result, path: Path, choice: Choice) -> None:
    _write_keep([f"{name}.png" for name in image_names(result)], result, path, choice)


def _write_nerfstudio(result: Result, path: Path, choice: Choice) -> None:
    _write_keep([f"masks/{name}.png" for name in result.probe.names], result, path, choice)


def _write_keep(names: Sequence[str], result: Result, path: Path, choice: Choice) -> None:
    for name, ids in zip(names, painted(result, "group", choice.when), strict=True):
        files.write(path / name, encode_keep(ids > 0, choice.dilate))


# ------------------------------------------------------------------ cues
def _rows(result: Result, stage: str, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Names of frames and rows of a video array, read in blocks."""
    artifact = result.artifact(stage)
    names, count = result.probe.names, artifact.shape(name)[0]
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        yield from zip(names[start:stop], artifact.read(name, start, stop), strict=True)


def _write_flow(result: Result, path: Path, choice: Choice) -> None:
    """``forward`` and ``backward``, a file a pair, called like its first frame."""
    for side in SIDES:
        (path / side).mkdir(parents=True)
        for name, flow in _rows(result, "flow", side):
            file = path / side / f"{name}.{choice.format}"
            if choice.format == "flo":
                write_flo(file, flow)
            elif choice.format == "npy":
                np.save(file, flow)
            else:
                files.write(file, encode_kitti(flow, f"{result.name}, frame {name}"))


def _write_depth(result: Result, path: Path, choice: Choice) -> None:
    """Relative inverse depth, a file a frame."""
    path.mkdir(parents=True)
    largest = 0.0
    if choice.format == "png":
        largest = max(
            float(np.nanmax(depth, initial=0)) for _, depth in _rows(result, "depth", "inverse_depth")
        )
    for name, depth in _rows(result, "depth", "inverse_depth"):
        if choice.format == "npy":
            np.save(path / f"{name}.npy", depth.astype(np.float32))
        else:
            files.write(path / f"{name}.png", encode_depth(depth.astype(np.float32), largest))


# ------------------------------------------------------------------ copies
def _write_netcdf(result: Result, path: Path, choice: Choice) -> None:
    write_netcdf(result, path, number_tables(result, choice.what, choice.when), choice.cues)


def _write_zarr(result: Result, path: Path, choice: Choice) -> None:
    write_zarr(result, path, number_tables(result, choice.what, choice.when), choice.cues)


Writer = Callable[[Result, Path, Choice], None]

WRITERS: dict[str, Writer] = {
    "davis": _write_davis,
    "npz": _write_npz,
    "coco": _write_coco,
    "ytvis": _write_ytvis,
    "mots": _write_mots,
    "colmap": _write_colmap,
    "nerfstudio": _write_nerfstudio,
    "netcdf": _write_netcdf,
    "zarr": _write_zarr,
}
"""Of each format with one file or folder a video."""

CUE_WRITERS: dict[str, Writer] = {"flow": _write_flow, "depth": _write_depth}
"""Of each cue."""
