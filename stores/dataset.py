"""A finished artifact as users see it: an ``xarray.Dataset``, read lazily, labelled, in physical units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zsmoseg.errors import StoreError
from zsmoseg.stores import files
from zsmoseg.stores.artifact import AGAIN, Artifact
from zsmoseg.stores.checks import joined_problem, part_problem

if TYPE_CHECKING:
    import xarray as xr


def open_dataset(artifact: Artifact) -> xr.Dataset:
    """Every array of an artifact, read when used: what ``xarray.open_zarr`` gives of its folder.

    Raises
    ------
    StoreError
        If anything is missing or has another size than was written: missing data would read as fill values. Content
        is compared with its checksum when it is read: of a file by ``compared``, and Zarr raises a ``ValueError`` where a
        piece of a shard differs; ``zsmoseg repair`` takes the file back, and the next run makes it again.
    """
    import xarray as xr

    from zsmoseg.stores.compared import compared

    problems = [problem for part in range(len(artifact.parts)) if (problem := part_problem(artifact, part))]
    if not problems and artifact.parts and (problem := joined_problem(artifact)):
        problems = [problem]
    if problems or not artifact.parts:
        raise StoreError(f"{artifact.path}: {(problems or ['nothing here'])[0]}; {AGAIN}")
    place = files.zip_store(artifact.archive) if artifact.packed else compared(artifact)
    try:
        found: xr.Dataset = xr.open_zarr(place, chunks=None)
    except StoreError:
        raise
    # coordinates are read at once, and Zarr, its codecs and zipfile raise their own
    except Exception as error:
        raise StoreError(f"{artifact.path}: cannot be opened ({error}); {AGAIN}") from error
    return found
