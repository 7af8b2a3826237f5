"""Run lengths as COCO has them, through pycocotools."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco

from zsmoseg.errors import FormatError

BITS = 35
"""Of a run at most, with its sign: seven characters."""
STROKES = (0, 2, 4)
"""Numbers of a polygon of fewer than three points."""
BORDER = 1 << 21
"""px of the border of a polygon at most; drawing takes about 100 bytes for each."""


def encode(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """``size`` and ``counts`` (a string) of a mask (H, W), ready for JSON."""
    found = coco.encode(np.asfortranarray(mask, np.uint8))
    return {"size": list(map(int, found["size"])), "counts": found["counts"].decode("ascii")}


def area(rle: dict[str, Any]) -> int:
    """Pixels of a mask."""
    return int(coco.area(rle))


def box(rle: dict[str, Any]) -> list[float]:
    """x, y, width, height of a mask."""
    return [float(value) for value in coco.toBbox(rle)]


def decode(segmentation: Any, size: tuple[int, int], where: str) -> tuple[NDArray[np.bool_] | None, int]:
    """A mask (H, W) from run lengths (compressed or not) or a list of polygons, None where nothing is drawn.

    Parameters
    ----------
    segmentation : as in the JSON.
    size : (H, W) of the image.
    where : begins the errors.

    Returns
    -------
    The mask, and how many polygons of fewer than three points were left out: they have no inside.

    Raises
    ------
    FormatError
        If it is neither, damaged, or of another size.
    """
    if isinstance(segmentation, dict) and {"size", "counts"} <= segmentation.keys():
        if segmentation["size"] != list(size):
            raise FormatError(
                f"{where}: the run lengths are of {segmentation['size']}, the image is {list(size)}; "
                "encode the masks in its size"
            )
        drawn: Any = segmentation
    elif isinstance(segmentation, list):
        drawn = [polygon for polygon in segmentation if not _is_stroke(polygon)]
    else:
        raise FormatError(f"{where}: the segmentation is neither run lengths nor polygons")
    try:
        return (_decode(drawn, size) if drawn else None), len(segmentation) - len(drawn)
    except Exception as error:  # pycocotools raises plain ones too
        raise FormatError(f"{where}: the segmentation is damaged ({error}); write the file anew") from error


def draws(segmentation: Any) -> bool:
    """Whether a segmentation is more than null, no polygon, or run lengths of nothing; what is damaged is left for ``decode``."""
    if not isinstance(segmentation, dict):
        return bool(segmentation)
    counts = segmentation.get("counts")
    try:
        return any((counts if isinstance(counts, list) else run_lengths(counts or ""))[1::2])
    except (TypeError, ValueError):
        return True


def _is_stroke(polygon: Any) -> bool:
    """Whether a polygon has fewer than three points."""
    return (
        isinstance(polygon, list)
        and len(polygon) in STROKES
        and all(isinstance(value, int | float) for value in polygon)
    )


def _decode(segmentation: Any, size: tuple[int, int]) -> NDArray[np.bool_]:
    if isinstance(segmentation, list):
        polygons = [_polygon(p, size) for p in segmentation]
        segmentation = coco.merge(coco.frPyObjects(polygons, *size))
    counts = segmentation["counts"]
    runs = counts if isinstance(counts, list) else run_lengths(counts)
    if sum(runs) != size[0] * size[1] or min(runs) < 0:
        raise ValueError(f"the runs make {sum(runs)} of {size[0] * size[1]} pixels")
    return np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(size[::-1]).T


def _polygon(points: Any, size: tuple[int, int]) -> list[float]:
    """x, y, x, y, ... of a polygon that pycocotools can draw: it checks nothing, and takes memory for each px of border.

    Raises
    ------
    ValueError
        If it has no three points, or one that is no number or far from the image; if its border is endless.
    """
    found = np.asarray(points, float).ravel()
    if len(found) < 6 or len(found) % 2:
        raise ValueError(f"a polygon of {len(found)} numbers; it takes x and y of three points at least")
    xy, sides = found.reshape(-1, 2), np.array(size[::-1], float)
    far = ~((xy >= -sides) & (xy <= 2 * sides)).all(1)  # NaN too
    if far.any():
        x, y = xy[far][0]
        raise ValueError(f"the point {x:g}, {y:g} of a polygon is no number or far from the image of {size}")
    border = np.abs(xy - np.roll(xy, 1, 0)).max(1).sum()
    if border > BORDER:
        raise ValueError(f"the border of a polygon is {border:g} px long; at most {BORDER} px are drawn")
    return [float(value) for value in found]


def run_lengths(counts: str | bytes) -> list[int]:
    """The runs of a compressed string: five bits a character, and from the third run on the difference to the
    last but one (``rleFrString`` of pycocotools, whose decoder fills what a string cut short lacks with whatever
    is in memory).
    """
    characters = counts.encode("ascii") if isinstance(counts, str) else counts
    runs: list[int] = []
    value = shift = 0
    for character in characters:
        bits = character - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if shift > BITS:
            raise ValueError("a run is longer than any image")
        if not bits & 0x20:
            value -= (bits & 0x10) and 1 << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    return runs


def packed(masks: Iterable[NDArray[np.bool_]]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Masks (H, W) as run lengths one behind the other: how many bytes each has (n), and the bytes."""
    counts = [coco.encode(np.asfortranarray(mask, np.uint8))["counts"] for mask in masks]
    return np.array([len(c) for c in counts], np.int64), np.frombuffer(b"".join(counts), np.uint8)


def unpacked(
    length: NDArray[np.int64], run: NDArray[np.uint8], size: tuple[int, int]
) -> list[dict[str, Any]]:
    """What ``packed`` made, as pycocotools has them; ``size`` is (H, W)."""
    ends = np.cumsum([0, *length])
    return [{"size": list(size), "counts": run[a:b].tobytes()} for a, b in pairwise(ends)]


def mask_of(rle: dict[str, Any]) -> NDArray[np.bool_]:
    """(H, W) of run lengths that were packed here: files of others go through ``decode``."""
    return _decode(rle, tuple(rle["size"]))


def overlaps_of(rles: list[dict[str, Any]]) -> NDArray[np.float64]:
    """(n, n) intersection over union."""
    return np.asarray(coco.iou(rles, rles, [0] * len(rles)) if rles else np.zeros((0, 0)))
