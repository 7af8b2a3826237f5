"""Laying an artifact out, before its first part: its description, and the metadata of its video arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.artifact import ABOUT, Artifact
from zsmoseg.stores.inside import Folder
from zsmoseg.stores.packing import json_bytes
from zsmoseg.stores.records import RECORDS, as_json
from zsmoseg.stores.schema import ArraySpec


def plan_of(
    description: Mapping[str, Any],
    parts: Sequence[tuple[int, int]],
    video_arrays: Sequence[ArraySpec] = (),
) -> dict[str, Any]:
    """The first record of an artifact.

    Parameters
    ----------
    description
        Stage, version, settings, keys of inputs and what else is worth knowing; JSON types.
    parts
        The frames of each part, in order, without gaps. With video arrays all but the last are equally
        long.

    Raises
    ------
    ValueError
        If the parts are not such.
    """
    _check_cut(parts, video_arrays)
    arrays = {spec.name: spec.to_json() for spec in video_arrays}
    return as_json({**description, "parts": parts, "arrays": arrays})


def begin(artifact: Artifact, content: Mapping[str, Any]) -> None:
    """Lay an artifact out in a folder, or mend its metadata; data and records stay. For one planner at a time.

    An artifact that exists keeps the parts that it was begun with; one whose arrays are of another kind is begun
    anew. ``content``: see ``plan_of``.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    old, folder, new = artifact.laid_out, Folder(artifact.path), dict(content)
    if old and old["arrays"] == new["arrays"] and old["parts"][-1][1] == new["parts"][-1][1]:
        new["parts"] = old["parts"]
    elif old or _cut_otherwise(artifact, new["parts"]):
        files.remove(artifact.path)
    if new != old:
        folder.put(ABOUT, new)
    files.touch(folder.record_place(ABOUT))
    for name, text in array_metadata(new).items():
        if folder.read(f"{name}/zarr.json") != text:
            files.write_whole(folder.place(f"{name}/zarr.json"), text)
    if artifact.done is None:
        for leftover in files.leftovers(artifact.path):
            files.remove(leftover)


def array_metadata(laid_out: Mapping[str, Any]) -> dict[str, bytes]:
    """The ``zarr.json`` of every video array, by the array's name."""
    return {
        name: json_bytes(ArraySpec.from_json(about).metadata(first_part(laid_out)))
        for name, about in laid_out.get("arrays", {}).items()
    }


def first_part(laid_out: Mapping[str, Any]) -> int:
    """Frames of every part but the last: the rows of a full shard."""
    start, stop = laid_out["parts"][0]
    return int(stop - start)


def _cut_otherwise(artifact: Artifact, parts: Sequence[tuple[int, int]]) -> bool:
    """Whether records are left from a time when the artifact was cut in another way."""
    alone = {path.stem for path in files.matching(artifact.path / RECORDS, "[0-9]*.json")}
    known = alone.union((artifact.done or {}).get("parts", {}))
    records = [
        (int(name), record) for name in filter(str.isdigit, known) if (record := artifact.part(int(name)))
    ]
    return any(i >= len(parts) or [record.start, record.stop] != list(parts[i]) for i, record in records)


def _check_cut(parts: Sequence[tuple[int, int]], video_arrays: Sequence[ArraySpec]) -> None:
    if not parts or parts[0][0] != 0 or any(a[1] != b[0] for a, b in pairwise(parts)):
        raise ValueError(f"parts {list(parts)} do not follow each other from frame 0 on")
    length, last = parts[0][1], parts[-1]
    regular = all(stop - start == length for start, stop in parts[:-1]) and 0 < last[1] - last[0] <= length
    if video_arrays and not regular:
        raise ValueError(f"parts {list(parts)} are not equally long: a part is a shard of every array")
    for spec in video_arrays:
        if spec.shape[0] != last[1] - (spec.dims[0] == "pair"):
            raise ValueError(f"{spec.name}: {spec.shape[0]} rows do not fit {last[1]} frames")
