"""A finished artifact as users see it: an ``xarray.Dataset``, read lazily, labelled, in physical units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from zsmoseg.errors import StoreError
from zsmoseg.stores.reader import AGAIN, read_tables

if TYPE_CHECKING:
    import xarray as xr

    from zsmoseg.stores.artifact import Artifact

LABELS = {"component": ["x", "y"], "channel": ["blue", "green", "red"]}
"""Coordinates of the dimensions that always mean the same."""

Table = tuple[np.ndarray[Any, Any], tuple[str, ...]]


def open_dataset(artifact: Artifact, times: Sequence[float], names: Sequence[str]) -> xr.Dataset:
    """Open an artifact.

    Parameters
    ----------
    times, names
        Of every frame: seconds, and what the source calls it. A pair has those of its first frame.

    Returns
    -------
    Video arrays, read when used; and those tables whose first dimension was called ``frame`` or ``pair`` when
    they were written, and which fit together, from all parts. Coordinates frame, time (s), name; component and channel by name.

    Raises
    ------
    StoreError
        If a part is missing or damaged: missing data would read as fill values.
    """
    import xarray as xr

    problems = [problem for part in range(len(artifact.parts)) if (problem := artifact.part_problem(part))]
    if problems or not artifact.parts:
        raise StoreError(f"{artifact.path}: {(problems or ['nothing here'])[0]}; {AGAIN}")
    found = xr.open_zarr(artifact.data, consolidated=False, chunks=None)
    return _label(found.assign(_joined_tables(artifact)), times, names)


def _label(found: xr.Dataset, times: Sequence[float], names: Sequence[str]) -> xr.Dataset:
    """With coordinates; where there are frames and pairs, time and name are those of the frames."""
    for dim in [d for d in ("pair", "frame") if d in found.sizes]:
        count = found.sizes[dim]
        if dim == "pair":
            found = found.assign_coords(pair=np.arange(count))
        if dim == "frame" or "frame" not in found.sizes:
            found = found.assign_coords(
                frame=(dim, np.arange(count)),
                time=(dim, np.asarray(times[:count], float), {"units": "s"}),
                name=(dim, np.asarray(names[:count], object)),
            )
    return found.assign_coords({dim: labels for dim, labels in LABELS.items() if dim in found.sizes})


def _joined_tables(artifact: Artifact) -> dict[str, tuple[tuple[str, ...], np.ndarray[Any, Any]]]:
    parts = [read_tables(artifact, part, "") for part in range(len(artifact.parts))]
    frames = artifact.parts[-1][1]
    joined = {}
    for name in parts[0]:
        tables = [part[name] for part in parts if name in part]
        if len(tables) == len(parts) and _fit(tables):
            values = np.concatenate([values for values, _ in tables])
            dims = tables[0][1]
            if len(values) == frames - (dims[0] == "pair"):
                joined[name] = (dims, values)
    return joined


def _fit(tables: Sequence[Table]) -> bool:
    """Whether tables go on from part to part: frame or pair first, the other dimensions equally long."""
    kinds = {(values.shape[1:], dims, values.dtype) for values, dims in tables}
    return len(kinds) == 1 and tables[0][1][:1] in (("frame",), ("pair",))
