"""Tracks as YouTube-VIS JSON: videos, and annotations with one segmentation a frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats import rle
from zsmoseg.formats.annotations import (
    NO_PIXEL,
    STROKES,
    Entry,
    choose_video,
    entries,
    field,
    normalised_notes,
    score_of,
    size_of,
)
from zsmoseg.formats.coco import categories_of_ids, dump
from zsmoseg.formats.names import inside
from zsmoseg.formats.overlaps import FrameMasks, MaskSource, refuse_many, stack
from zsmoseg.formats.track_ids import ids_in_order

UNSEEN = "tracks without a mask in any frame"
"""What is left out of YouTube-VIS JSON."""


class Tracks(MaskSource):
    """The tracks of one video, numbered 1.. in order of their ids."""

    def __init__(self, path: Path, content: Entry, video: str | None) -> None:
        by_name = {_name(v, path): v for v in entries(content, "videos", path)}
        if not by_name:
            raise FormatError(f"{path}: holds no videos; export it with its videos")
        name = choose_video(list(by_name), video, path)
        chosen, where = by_name[name], f"{path}, video {name}"
        files = field(chosen, "file_names", list, where)
        frames = [inside(str(file), where).stem for file in files]
        super().__init__(path, frames, len(frames), size_of(chosen, where), ids=True)
        everything = entries(content, "annotations", path)
        found = [
            a
            for a in everything
            if field(a, "video_id", int, f"{path}, annotation {a['id']}") == chosen["id"]
        ]
        self.left_out += Counter({"annotations of other videos": len(everything) - len(found)})
        self._tracks = sorted(found, key=lambda a: int(a["id"]))
        self._scored = bool(found) and all("score" in a for a in found)
        for track in self._tracks:
            which = f"{where}, annotation {track['id']}"
            length = len(field(track, "segmentations", list, which))
            if length != len(frames):
                raise FormatError(
                    f"{which}: has {length} segmentations for {len(frames)} frames; give null where none"
                )
        unseen = sum(not any(map(rle.draws, t["segmentations"])) for t in self._tracks)
        self.left_out += Counter({UNSEEN: unseen})
        note = ids_in_order([t["id"] for t in self._tracks])
        self.notes += [*([note] if note else []), *normalised_notes(_each_segmentation(self._tracks))]

    def _read(self, index: int) -> FrameMasks:
        assert self.frames is not None
        where = f"{self.path}, {self.frames[index]}"
        seen = [(n, t) for n, t in enumerate(self._tracks, 1) if t["segmentations"][index] is not None]
        refuse_many(len(seen), self.size, where, max((n for n, _ in seen), default=0))
        drawn = [
            (n, t, *rle.decode(t["segmentations"][index], self.size, f"{where}, annotation {t['id']}"))
            for n, t in seen
        ]
        kept = [(n, t, mask) for n, t, mask, _ in drawn if mask is not None]
        scores = [score_of(t, where) for _, t, _ in kept] if self._scored else None
        none = sum(not mask.any() and isinstance(t["segmentations"][index], list) for _, t, mask in kept)
        left_out = Counter({STROKES: sum(n for *_, n in drawn), NO_PIXEL: none})
        return stack([m for *_, m in kept], self.size, [n for n, *_ in kept], scores, +left_out)


def _each_segmentation(tracks: Sequence[Entry]) -> Iterator[Any]:
    for track in tracks:
        yield from track["segmentations"]


def _name(video: Entry, path: Path) -> str:
    """What a video is called: ``name``, else the folder of its files."""
    where = f"{path}, video {video['id']}"
    if "name" in video:
        return inside(field(video, "name", str, where), where).as_posix()
    files = field(video, "file_names", list, where)
    if not files:
        raise FormatError(f"{where}: has no file_names; list its frames")
    return inside(str(files[0]), where).parent.as_posix()


def encode_ytvis(
    video: str,
    names: Sequence[str],
    labels: Iterable[NDArray[Any]],
    size: tuple[int, int],
    called: Mapping[int, str] = MappingProxyType({}),
) -> bytes:
    """YouTube-VIS JSON of one video; an id becomes the id of its annotation.

    Parameters
    ----------
    names : file name of every frame.
    labels : (H, W) ids of every frame, 0 = none.
    size : (H, W).
    called : category of each id that has one.
    """
    categories, numbers = categories_of_ids(called)
    tracks: dict[int, list[Entry | None]] = {}
    for t, label in enumerate(labels):
        for n in np.unique(label[label > 0]).tolist():
            tracks.setdefault(n, [None] * len(names))[t] = rle.encode(label == n)
    shape = {"height": size[0], "width": size[1], "length": len(names)}
    annotations = [
        {
            "id": n,
            "video_id": 1,
            "category_id": numbers.get(n, 1),
            "iscrowd": 0,
            **shape,
            "segmentations": masks,
            "bboxes": [mask and rle.box(mask) for mask in masks],
            "areas": [mask and rle.area(mask) for mask in masks],
        }
        for n, masks in sorted(tracks.items())
    ]
    about = {"id": 1, "name": video, "file_names": list(names), **shape}
    return dump({"videos": [about], "annotations": annotations, "categories": categories})
