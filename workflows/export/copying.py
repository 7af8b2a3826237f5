"""A copy of one video as NetCDF or Zarr: labels, masks, motion state and cues, with coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import __version__
from zsmoseg.stores.dataset import open_dataset
from zsmoseg.workflows.export.painting import number_tables
from zsmoseg.workflows.export.registry import Choice
from zsmoseg.workflows.result import BLOCK, Result

if TYPE_CHECKING:
    import xarray as xr

Ids = NDArray[np.uint16]
"""(frames, objects), see ``number_tables``."""

CONTENTS = {"flow": ("forward", "backward", "valid"), "depth": ("inverse_depth",)}
"""Variables of each cue."""


def write_netcdf(result: Result, path: Path, choice: Choice) -> None:
    """A NetCDF 4 file, read by ``xarray.open_dataset``; compressed, one chunk a frame."""
    dataset, encoding = _described(result, choice)
    images = {name: variable for name, variable in dataset.data_vars.items() if variable.ndim > 2}
    dataset.drop_vars(images).to_netcdf(path, engine="h5netcdf")
    for name, variable in images.items():  # all at once, the order in the file would change from time to time
        chunks = (1,) * (variable.ndim - 2) + variable.shape[-2:]
        stored = {**encoding.get(str(name), {}), "zlib": True, "complevel": 1, "chunksizes": chunks}
        alone = variable.drop_vars(variable.coords).to_dataset(name=name)
        with _in_order():
            alone.to_netcdf(path, mode="a", engine="h5netcdf", encoding={name: stored})


def write_zarr(result: Result, path: Path, choice: Choice) -> None:
    """A Zarr group, read by ``xarray.open_zarr``; of version 2, for version 3 has no strings yet."""
    dataset, encoding = _described(result, choice)
    with _in_order():
        dataset.to_zarr(path, encoding=encoding, zarr_format=2)


def _in_order() -> Any:
    """One block after the other: little memory, and the same bytes each time."""
    import dask

    return dask.config.set(scheduler="synchronous")


def _described(result: Result, choice: Choice) -> tuple[xr.Dataset, dict[str, dict[str, Any]]]:
    """The copy, read when written, and how scaled numbers are stored."""
    ids = number_tables(result, choice.what, choice.when)
    dataset = _copy(result, ids, choice.cues)
    encoding = {
        str(name): {
            "dtype": variable.encoding["dtype"],
            "_FillValue": variable.encoding["_FillValue"],
            "scale_factor": np.float32(variable.encoding["scale_factor"]),
        }
        for name, variable in dataset.data_vars.items()
        if "scale_factor" in variable.encoding
    }
    return dataset.drop_encoding(), encoding


def _copy(result: Result, ids: Ids, cues: Sequence[str]) -> xr.Dataset:
    """Video arrays in blocks of frames; tables by object."""
    import xarray as xr

    probe = result.probe
    label = open_dataset(result.artifact("labels"))["label"]
    label = label.drop_vars(["time", "name"]).chunk(frame=BLOCK)
    tables = xr.DataArray(ids, dims=("frame", "object"))
    mask = xr.apply_ufunc(
        lambda frame, table: table[frame],
        label,
        tables,
        input_core_dims=[["y", "x"], ["object"]],
        output_core_dims=[["y", "x"]],
        vectorize=True,
        dask="parallelized",
        output_dtypes=[np.uint16],
    )
    groups = result.groups
    found = xr.Dataset(
        {
            "label": label,
            "mask": mask.assign_attrs(long_name="exported id of the pixel, 0 = none"),
            "moving": (("frame", "object"), result.moving(), {"long_name": "the object moves at the frame"}),
            "group": ("object", groups.group, {"long_name": "group of the object, 0 = static"}),
            "instance": (
                "object",
                groups.instance,
                {"long_name": "object that it is a piece of, 0 = static"},
            ),
        },
        coords={
            "time": ("frame", np.asarray(probe.times), {"units": "s"}),
            "name": ("frame", np.asarray(probe.names, object)),
            "object": np.arange(len(groups.group)),
            "y": np.arange(probe.height),
            "x": np.arange(probe.width),
        },
        attrs={"title": result.name, "history": f"zsmoseg {__version__} export"},
    )
    return found.merge(xr.merge([_cue(result, cue) for cue in cues]))


def _cue(result: Result, cue: str) -> xr.Dataset:
    """A cue on the working grid; ``grid_y``, ``grid_x`` say where its pixels lie in the displayed frame."""
    probe = result.probe
    found = open_dataset(result.artifact(cue))[list(CONTENTS[cue])]
    found = found.drop_vars(["time", "name", "y", "x"]).rename(y="grid_y", x="grid_x")
    if cue != "flow":
        found = found.astype(np.float32)  # NetCDF has no half precision
    found = found.chunk({"pair" if cue == "flow" else "frame": BLOCK})
    places = {
        grid: (np.arange(found.sizes[grid]) + 0.5) * full / found.sizes[grid] - 0.5
        for grid, full in (("grid_y", probe.height), ("grid_x", probe.width))
    }
    return found.assign_coords(places)
