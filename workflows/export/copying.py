"""A copy of one video as NetCDF or Zarr: labels, masks, motion state and cues, with coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg import __version__
from zsmoseg.flow import STATES
from zsmoseg.workflows.reading import read_states
from zsmoseg.workflows.result import BLOCK, Result

if TYPE_CHECKING:
    import xarray as xr

Ids = NDArray[np.uint16]
"""(frames, objects), see ``number_tables``."""

CONTENTS = {"flow": ("forward", "backward"), "depth": ("inverse_depth",)}
"""Variables of each cue."""


def write_netcdf(result: Result, path: Path, ids: Ids, cues: Sequence[str]) -> None:
    """A NetCDF 4 file, read by ``xarray.open_dataset``; compressed, one chunk a frame."""
    dataset, encoding = _described(result, ids, cues)
    images = {name: variable for name, variable in dataset.data_vars.items() if variable.ndim > 2}
    dataset.drop_vars(images).to_netcdf(path, engine="h5netcdf")
    for name, variable in images.items():  # all at once, the order in the file would change from time to time
        chunks = (1,) * (variable.ndim - 2) + variable.shape[-2:]
        stored = {**encoding.get(str(name), {}), "zlib": True, "complevel": 1, "chunksizes": chunks}
        alone = variable.drop_vars(variable.coords).to_dataset(name=name)
        with _in_order():
            alone.to_netcdf(path, mode="a", engine="h5netcdf", encoding={name: stored})


def write_zarr(result: Result, path: Path, ids: Ids, cues: Sequence[str]) -> None:
    """A Zarr group, read by ``xarray.open_zarr``; of version 2, for version 3 has no strings yet."""
    dataset, encoding = _described(result, ids, cues)
    with _in_order():
        dataset.to_zarr(path, encoding=encoding, zarr_format=2)


def _in_order() -> Any:
    """One block after the other: little memory, and the same bytes each time."""
    import dask

    return dask.config.set(scheduler="synchronous")


def _described(result: Result, ids: Ids, cues: Sequence[str]) -> tuple[xr.Dataset, dict[str, dict[str, Any]]]:
    """The copy, read when written, and how scaled numbers are stored."""
    dataset = _copy(result, ids, cues)
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
    label = result.artifact("labels").dataset(probe.times, probe.names)["label"]
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
    table = result.artifact("groups").read_table(0)
    found = xr.Dataset(
        {
            "label": label,
            "mask": mask.assign_attrs(long_name="exported id of the pixel, 0 = none"),
            "moving": (("frame", "object"), result.moving(), {"long_name": "the object moves at the frame"}),
            "group": ("object", table["group"], {"long_name": "group of the object, 0 = static"}),
            "thing": ("object", table["thing"], {"long_name": "thing of the object, 0 = static"}),
        },
        coords={
            "time": ("frame", np.asarray(probe.times), {"units": "s"}),
            "name": ("frame", np.asarray(probe.names, object)),
            "object": np.arange(len(table["group"])),
            "y": np.arange(probe.height),
            "x": np.arange(probe.width),
        },
        attrs={"title": result.name, "history": f"zsmoseg {__version__} export"},
    )
    return found.merge(xr.merge([_cue(result, cue) for cue in cues]))


def _cue(result: Result, cue: str) -> xr.Dataset:
    """A cue on the working grid; ``grid_y``, ``grid_x`` say where its pixels lie in the displayed frame."""
    probe = result.probe
    found = result.artifact(cue).dataset(probe.times, probe.names)
    found = found[list(CONTENTS[cue])].rename(y="grid_y", x="grid_x")
    found = found.drop_vars(["time", "name"])
    if cue == "flow":
        valid = read_states(result.artifact(cue), 0, found.sizes["pair"]) == STATES.index("ok")
        found = found.drop_vars("frame").assign(valid=("pair", valid))
    else:
        found = found.astype(np.float32)  # NetCDF has no half precision
    found = found.chunk({"pair" if cue == "flow" else "frame": BLOCK})
    places = {
        grid: (np.arange(found.sizes[grid]) + 0.5) * full / found.sizes[grid] - 0.5
        for grid, full in (("grid_y", probe.height), ("grid_x", probe.width))
    }
    return found.assign_coords(places)
