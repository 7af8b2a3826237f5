"""Masks as COCO JSON: images and annotations, run lengths or polygons."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import FormatError
from zsmoseg.formats import rle
from zsmoseg.formats.annotations import Entry, choose_video, entries, field, score_of, size_of
from zsmoseg.formats.names import inside
from zsmoseg.formats.overlaps import HIGHEST, FrameMasks, MaskSource, refuse_many, stack, text

IDS = ("track_id", "instance_id")
"""Fields of annotations that tell objects through the video."""


class CocoImages(MaskSource):
    """The images of one video and their annotations; crowds are no objects and are left out."""

    def __init__(self, path: Path, content: Entry, video: str | None) -> None:
        images = _images_of(entries(content, "images", path), video, path)
        self._names = {image["id"]: image["file_name"] for image in images}
        self._annotations: dict[int, list[Entry]] = {image["id"]: [] for image in images}
        known = {image["id"] for image in entries(content, "images", path)}
        for annotation in entries(content, "annotations", path):
            where = f"{path}, annotation {annotation['id']}"
            image = field(annotation, "image_id", int, where)
            if image not in known:
                raise FormatError(
                    f"{where}: there is no image {image} in the file; mend image_id or remove it"
                )
            if image in self._annotations and not annotation.get("iscrowd"):
                self._annotations[image].append(annotation)
        own = [a for found in self._annotations.values() for a in found]
        self._key = _id_field(own, path)
        self._scored = bool(own) and all("score" in a for a in own)
        frames = [inside(image["file_name"], str(path)).stem for image in images]
        super().__init__(path, frames, len(frames), _common_size(images, path), ids=self._key is not None)
        self._images = [image["id"] for image in images]

    def _read(self, index: int) -> FrameMasks:
        image = self._images[index]
        found = self._annotations[image]
        where = f"{self.path}, {self._names[image]}"
        refuse_many(len(found), self.size, where)
        masks = [
            rle.decode(a.get("segmentation"), self.size, f"{where}, annotation {a['id']}") for a in found
        ]
        scores = [score_of(a, where) for a in found] if self._scored else None
        return stack(masks, self.size, self._numbers(found, where), scores)

    def _numbers(self, found: Sequence[Entry], where: str) -> list[int] | None:
        if self._key is None:
            return None
        numbers = [int(field(a, self._key, int, where)) for a in found]
        wrong = [n for n in numbers if not 1 <= n <= HIGHEST or numbers.count(n) > 1]
        if wrong:
            raise FormatError(
                f"{where}: {self._key} {wrong[0]} stands twice in one image, or not between 1 and {HIGHEST}; "
                "give each object a number of its own"
            )
        return numbers


def _images_of(images: list[Entry], video: str | None, path: Path) -> list[Entry]:
    """The images of one video: those in one folder."""
    by_folder: dict[str, list[Entry]] = {}
    for image in images:
        name = inside(field(image, "file_name", str, f"{path}, image {image['id']}"), str(path))
        by_folder.setdefault(name.parent.as_posix(), []).append(image)
    if not by_folder:
        raise FormatError(f"{path}: holds no images; export it with its images")
    return by_folder[choose_video(list(by_folder), video, path)]


def _id_field(annotations: Sequence[Entry], path: Path) -> str | None:
    """The field that holds the ids of objects, if all have it."""
    for key in IDS:
        having = sum(key in a for a in annotations)
        if having and having < len(annotations):
            raise FormatError(
                f"{path}: {having} of {len(annotations)} annotations have a {key}; give it to all or to none"
            )
        if having:
            return key
    return None


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
