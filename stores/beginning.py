"""Laying an artifact out, before its first part: its description, and the metadata of its video arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.records import as_json, write_record
from zsmoseg.stores.schema import ArraySpec, metadata_of


def begin(
    artifact: Artifact,
    description: Mapping[str, Any],
    parts: Sequence[tuple[int, int]],
    video_arrays: Sequence[ArraySpec] = (),
) -> None:
    """Lay an artifact out, or mend its metadata; data and records stay. For one planner at a time.

    An artifact that exists keeps the parts and codecs it was begun with; one whose arrays are of another
    kind is begun anew.

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
    SpaceError
        If the disk is full.
    """
    _check_cut(parts, video_arrays)
    arrays = {spec.name: spec.to_json() for spec in video_arrays}
    content = as_json({**description, "parts": parts, "arrays": arrays})
    old = artifact.laid_out
    if old and old["arrays"] == content["arrays"] and old["parts"][-1][1] == content["parts"][-1][1]:
        content |= {"parts": old["parts"], "layout": old["layout"]}
    else:
        if old or _cut_otherwise(artifact, parts):
            files.remove(artifact.path)
        content["layout"] = metadata_of(video_arrays, parts[0][1] - parts[0][0])
    described = artifact.records / "artifact.json"
    if content != old:
        write_record(described, content)
    files.touch(described)
    for path, text in artifact.metadata():
        if files.read(path) != text:
            files.write_whole(path, text)
    if artifact.done is None:
        for leftover in files.leftovers(artifact.path):
            files.remove(leftover)


def _cut_otherwise(artifact: Artifact, parts: Sequence[tuple[int, int]]) -> bool:
    """Whether records are left from a time when the artifact was cut in another way."""
    known = [int(path.stem) for path in files.matching(artifact.records, "[0-9]*.json")]
    records = [(i, record) for i in known if (record := artifact.part(i))]
    return any(i >= len(parts) or (record.start, record.stop) != tuple(parts[i]) for i, record in records)


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
