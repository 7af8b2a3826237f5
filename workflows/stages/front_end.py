"""What every front end leaves, whatever proposes the objects: all behind it reads these and nothing before them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table, video

Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Objects(Arrays):
    """What every front end leaves of its objects: they are numbered through the video and live in one shot."""

    shot: Ids = table("shot", dtype="int64", meaning="shot")
    first_frame: Ids = table("shot", dtype="int64", meaning="its first frame")
    end_frame: Ids = table("shot", dtype="int64", meaning="the frame after its last one")
    last_object: Ids = table("shot", dtype="int64", meaning="largest object up to its end")
    object: Ids = table("object", dtype="int64", meaning="object")
    whole: Ids = table(
        "object",
        dtype="int64",
        meaning="what the proposals hold together, by its largest object: others may be torn off it",
    )


@dataclass(frozen=True)
class Labels(Arrays):
    """The objects as pixels, and how large each is."""

    label: NDArray[np.uint16] = video(
        "frame",
        "y",
        "x",
        dtype="uint16",
        meaning="object of the pixel, 0 = none",
        grid="displayed",
        codec="label",
    )
    object: Ids = table("object", dtype="int64", meaning="object")
    area: Ids = table("frame", "object", dtype="int64", meaning="pixels of the object", unit="px^2")


def labels_of(start: int, label: NDArray[np.uint16]) -> Labels:
    """Labels (frames, H, W) of the frames from ``start`` on, with the areas measured."""
    largest = int(label.max())
    area = np.stack([np.bincount(one.ravel(), minlength=largest + 1) for one in label])
    present = np.flatnonzero(area.any(0)).astype(np.int64)
    seen = area[:, present].astype(np.int64)
    return Labels(start=start, stop=start + len(label), label=label, object=present, area=seen)


def shrink(labels: NDArray[np.uint16], height: int, width: int) -> NDArray[np.uint16]:
    """Labels on the working grid: nearest."""
    size = width, height
    small: list[Any] = [cv2.resize(label, size, interpolation=cv2.INTER_NEAREST_EXACT) for label in labels]
    return np.stack(small)


@dataclass(frozen=True)
class Shot:
    """A shot: its number, its frames, and its objects by global id, the background first."""

    number: int
    start: int
    stop: int
    objects: Ids


def shots_of(objects: Objects) -> list[Shot]:
    """The shots of a video with their objects."""
    lasts = [0, *map(int, objects.last_object)]
    ends = zip(objects.first_frame, objects.end_frame, lasts[:-1], lasts[1:], strict=True)
    return [
        Shot(number, int(start), int(stop), np.append(0, np.arange(first + 1, last + 1)))
        for number, (start, stop, first, last) in enumerate(ends)
    ]


def shot_columns(
    frames: int, found: list[tuple[int, int]], last: list[int], whole: Ids | None = None
) -> dict[str, Any]:
    """The fields of ``Objects`` for shots (start, stop), the largest object up to the end of each, and the whole of each (N,),
    the object itself if not given.
    """
    first, end = np.array(found, np.int64).T
    number = np.arange(len(found), dtype=np.int64)
    columns = {
        "shot": number,
        "first_frame": first,
        "end_frame": end,
        "last_object": np.array(last, np.int64),
        "object": (objects := np.arange(max(last, default=0) + 1)),
        "whole": objects if whole is None else whole,
    }
    return {"start": 0, "stop": frames, **columns}


def local_ids(ids: Ids, shot: Shot) -> tuple[Ids, Ids]:
    """Slots of ``ids`` (global) that are objects of the shot, and their number within it."""
    keep = np.flatnonzero(np.isin(ids, shot.objects))
    return keep, np.searchsorted(shot.objects, ids[keep])
