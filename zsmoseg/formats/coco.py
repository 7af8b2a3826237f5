"""Masks as COCO JSON: images and annotations, run lengths or polygons."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats import rle
from zsmoseg.formats.annotations import (
    EMPTY,
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
from zsmoseg.formats.names import inside
from zsmoseg.formats.overlaps import FrameMasks, MaskSource, refuse_many, stack, text
from zsmoseg.formats.track_ids import Value, numbers_of, track_ids

CROWDS = "marked as crowds (iscrowd) and read as the masks they hold"


class CocoImages(MaskSource):
    """The images of one video and their annotations. Brush tools mark run lengths as crowds: those are masks as well."""

    def __init__(self, path: Path, content: Entry, video: str | None) -> None:
        everything = entries(content, "images", path)
        images = _images_of(everything, video, path)
        self._names = {image["id"]: image["file_name"] for image in images}
        own = _annotations_of(entries(content, "annotations", path), {i["id"] for i in everything}, path)
        given = [a for a in own if a["image_id"] in self._names]
        found = [a for a in given if a.get("segmentation", []) not in ([], None)]
        if given and not found:
            raise FormatError(
                f"{path}: none of its {len(given)} annotations has a mask (boxes alone?); export polygons or run lengths"
            )
        self._annotations: dict[int, list[Entry]] = {image["id"]: [] for image in images}
        for annotation in found:
            self._annotations[annotation["image_id"]].append(annotation)
        ids = track_ids(found, path)
        frames = [inside(image["file_name"], str(path)).stem for image in images]
        super().__init__(path, frames, len(frames), _common_size(images, path), ids=ids is not None)
        self._scored = bool(found) and all("score" in a for a in found)
        self._images = [image["id"] for image in images]
        self._told(found, ids)
        self.left_out += Counter(
            {EMPTY: len(given) - len(found), "annotations of other videos": len(own) - len(given)}
        )

    def _told(self, found: Sequence[Entry], ids: Sequence[Value] | None) -> None:
        """Number the objects, and note what is not plain."""
        numbers, note = numbers_of(ids or [], self.path)
        self._number = {a["id"]: numbers[n] for a, n in zip(found, ids or [], strict=bool(ids))}
        crowds = sum(bool(a.get("iscrowd")) for a in found)
        self.notes += [*([f"{crowds} {CROWDS}"] if crowds else []), *([note] if note else [])]
        self.notes += normalised_notes(a["segmentation"] for a in found)

    def _read(self, index: int) -> FrameMasks:
        image = self._images[index]
        found = self._annotations[image]
        where = f"{self.path}, {self._names[image]}"
        refuse_many(len(found), self.size, where)
        drawn = [
            (a, *rle.decode(a["segmentation"], self.size, f"{where}, annotation {a['id']}")) for a in found
        ]
        kept = [(a, mask) for a, mask, _ in drawn if mask is not None]
        left_out = Counter(
            {
                STROKES: sum(n for *_, n in drawn),
                EMPTY: len(drawn) - len(kept),
                NO_PIXEL: sum(not mask.any() for _, mask in kept),
            }
        )
        scores = [score_of(a, where) for a, _ in kept] if self._scored else None
        numbers = self._numbers([a for a, _ in kept], where)
        return stack([mask for _, mask in kept], self.size, numbers, scores, +left_out)

    def _numbers(self, found: Sequence[Entry], where: str) -> list[int] | None:
        if not self.ids:
            return None
        numbers = [self._number[a["id"]] for a in found]
        twice = [a for a, n in zip(found, numbers, strict=True) if numbers.count(n) > 1]
        if twice:
            raise FormatError(
                f"{where}: annotations {twice[0]['id']} and {twice[1]['id']} have one id; give each object an id of its own, "
                "or one annotation to all its pieces"
            )
        return numbers


def _annotations_of(annotations: list[Entry], images: set[int], path: Path) -> list[Entry]:
    """The annotations, each of an image that there is."""
    for annotation in annotations:
        where = f"{path}, annotation {annotation['id']}"
        image = field(annotation, "image_id", int, where)
        if image not in images:
            raise FormatError(f"{where}: there is no image {image} in the file; mend image_id or remove it")
    return annotations


def _images_of(images: list[Entry], video: str | None, path: Path) -> list[Entry]:
    """The images of one video: those in one folder."""
    by_folder: dict[str, list[Entry]] = {}
    for image in images:
        name = inside(field(image, "file_name", str, f"{path}, image {image['id']}"), str(path))
        by_folder.setdefault(name.parent.as_posix(), []).append(image)
    if not by_folder:
        raise FormatError(f"{path}: holds no images; export it with its images")
    return by_folder[choose_video(list(by_folder), video, path)]


def _common_size(images: Sequence[Entry], path: Path) -> tuple[int, int]:
    first, *others = [
        (image["file_name"], size_of(image, f"{path}, {image['file_name']}")) for image in images
    ]
    for name, size in others:
        if size != first[1]:
            raise FormatError(
                f"{path}, {name}: is {text(size)}, {first[0]} {text(first[1])}; give all in one size"
            )
    return first[1]


def encode_coco(
    names: Sequence[str],
    labels: Iterable[NDArray[Any]],
    size: tuple[int, int],
    called: Mapping[int, str] = MappingProxyType({}),
) -> bytes:
    """COCO JSON of one video, read back by ``pycocotools.coco.COCO``.

    Parameters
    ----------
    names : file name of every image.
    labels : (H, W) ids of every frame, 0 = none; an id becomes the ``track_id`` of its annotations.
    size : (H, W).
    called : category of each id that has one.
    """
    height, width = size
    categories, numbers = categories_of_ids(called)
    annotations: list[Entry] = []
    for image, label in enumerate(labels, 1):
        for n in np.unique(label[label > 0]).tolist():
            mask = rle.encode(label == n)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image,
                    "category_id": numbers.get(n, 1),
                    "track_id": n,
                    "segmentation": mask,
                    "area": rle.area(mask),
                    "bbox": rle.box(mask),
                    "iscrowd": 0,
                }
            )
    images = [
        {"id": image, "file_name": name, "height": height, "width": width}
        for image, name in enumerate(names, 1)
    ]
    return dump({"images": images, "annotations": annotations, "categories": categories})


def categories_of_ids(called: Mapping[int, str]) -> tuple[list[Entry], dict[int, int]]:
    """The list of categories, and the number that each id has in it; 1 is for all that nothing is known of."""
    found = sorted(set(called.values()) - {"object"})
    names = {"object": 1, **{name: number for number, name in enumerate(found, 2)}}
    entries: list[Entry] = [{"id": k, "name": name, "supercategory": "object"} for name, k in names.items()]
    return entries, {n: names[name] for n, name in called.items()}


def dump(content: Entry) -> bytes:
    """JSON as bytes, without blanks."""
    return json.dumps({"info": {"description": "zsmoseg"}, **content}, separators=(",", ":")).encode()
