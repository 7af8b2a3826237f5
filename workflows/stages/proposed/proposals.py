"""What the stage ``proposals`` leaves, whoever proposes: masks frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.formats.overlaps import FrameMasks
from zsmoseg.stores.arrays import Arrays, labels_of
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.fields import table, video


@dataclass(frozen=True)
class Proposals(Arrays):
    """The masks of every frame that has some; categories where a network names what it sees."""

    mask: NDArray[np.uint16] = video(
        "frame",
        "y",
        "x",
        dtype="uint16",
        meaning="number of the mask at the pixel, 0 = none",
        grid="displayed",
        codec="label",
    )
    known: NDArray[np.bool_] = table("frame", dtype="bool", meaning="whether there are masks of the frame")
    masks: NDArray[np.int64] = table("frame", dtype="int64", meaning="how many masks it has")
    number: NDArray[np.int64] = table(
        "mask_of_frame", dtype="int64", meaning="number of the mask, frame by frame"
    )
    score: NDArray[np.float32] | None = table("mask_of_frame", dtype="float32", meaning="score of the mask")
    category_of: NDArray[np.int64] | None = table(
        "mask_of_frame", dtype="int64", meaning="its category, an index of the coordinate category"
    )
    named: NDArray[np.int64] | None = table(
        "category", dtype="int64", meaning="masks of the category", add=True
    )


def proposals_of(
    start: int,
    found: Sequence[FrameMasks | None],
    size: tuple[int, int],
    category: Sequence[NDArray[np.int64]] = (),
    names: int = 0,
) -> Proposals:
    """Proposals of the frames from ``start`` on; None where a frame has none.

    Parameters
    ----------
    size
        Height and width of a frame.
    category
        Of each frame (masks), entry k that of the label k + 1; none where nothing is named.
    names
        Number of categories.
    """
    empty = np.zeros(size, np.uint16)
    labels = np.stack([empty if f is None else f.label for f in found])
    numbers = [np.unique(label[label > 0]).astype(np.int64) for label in labels]
    arrays: dict[str, Any] = {
        "mask": labels,
        "known": np.array([f is not None for f in found]),
        "masks": np.array([len(n) for n in numbers], np.int64),
        "number": np.concatenate([np.zeros(0, np.int64), *numbers]),
    }
    if names:
        scores = [np.zeros(0) if f is None or f.score is None else f.score for f in found]
        which = [c[n - 1] for c, n in zip(category, numbers, strict=True)]
        of = np.concatenate([np.zeros(0, np.int64), *which])
        arrays |= {
            "score": np.concatenate([s[n - 1] for s, n in zip(scores, numbers, strict=True)]).astype(
                np.float32
            ),
            "category_of": of,
            "named": np.bincount(of, minlength=names).astype(np.int64),
        }
    return Proposals(start=start, stop=start + len(found), **arrays)


def category_names(artifact: Artifact) -> list[str]:
    """The names of the categories of an artifact of any of these stages; none where nothing is named."""
    return list(labels_of(Proposals, artifact).get("category", ()))
