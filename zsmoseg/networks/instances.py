"""Instance masks of a network in one go: boxes, scores of categories, and masks from prototypes and coefficients.

Source: Bolya et al., "YOLACT: real-time instance segmentation", ICCV 2019, for masks as products of prototypes and
coefficients; the tensors are those of the YOLOv8 family.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError
from zsmoseg.networks.boxes import suppress
from zsmoseg.networks.categories import COCO
from zsmoseg.networks.contract import MAIN, NAME, Contract, Table
from zsmoseg.networks.image import Frame, Geometry, prepare
from zsmoseg.networks.session import Network


class Instances(Table):
    """The table ``[instances]`` of a contract."""

    categories: list[str] | Literal["coco"] | None = None
    scores: Literal["probabilities", "logits"] = "probabilities"
    boxes: Literal["centre-size", "corners"] = "centre-size"
    floor: float = 0.1
    """Best score of a category from which a candidate is kept: thresholds act above it."""
    most: int = 100
    """Candidates of a frame that are kept, the best first."""
    overlap: float = 0.7
    """Intersection over union of boxes from which the lower score is the same thing."""


@dataclass(frozen=True)
class Raw:
    """The candidates of a frame, before thresholds: box (n, 4) x0, y0, x1, y1 px of the frame, score (n, categories)."""

    box: NDArray[np.float32]
    score: NDArray[np.float32]
    mask: list[NDArray[np.bool_]]
    """n of (H, W)."""


def categories_of(contract: Contract) -> list[str]:
    """The names of the categories; numbers as words where the contract gives none.

    Raises
    ------
    ModelError
        The contract names another number of categories than the network scores.
    """
    named = contract.extra("instances", Instances).categories
    if named is None and any("coco" in output.meaning.lower() for output in contract.output):
        named = "coco"
    return list(COCO) if named == "coco" else list(named or [])


def network_instances(network: Network, frame: Frame) -> Raw:
    """The candidates of a frame (H, W, 3), blue green red.

    Raises
    ------
    ModelError
        The tensors have not the shapes of boxes, scores and coefficients.
    """
    rules = network.contract.extra("instances", Instances)
    tensor, where = prepare(frame, network.contract.image)
    found = network.run(MAIN, {"image": tensor}, ["predictions", "prototypes"])
    rows, prototypes = found["predictions"][0].T, found["prototypes"][0]
    names, classes = categories_of(network.contract), rows.shape[1] - 4 - len(prototypes)
    if classes < 1 or (names and len(names) != classes):
        raise ModelError(
            f"{network.contract.folder / NAME}: predictions have {rows.shape[1]} numbers a candidate, 4 of a box and "
            f"{len(prototypes)} coefficients among them, which leaves {classes} categories; it names {len(names)}"
        )
    score = rows[:, 4 : 4 + classes]
    if rules.scores == "logits":
        score = 1 / (1 + np.exp(-score))
    best = score.max(1)
    some = np.flatnonzero(best > rules.floor)
    corners = _corners(rows[some, :4], rules.boxes)
    kept = suppress(corners, best[some], rules.overlap)[: rules.most]
    some, corners = some[kept], corners[kept]
    masks = [
        _mask(row[4 + classes :], prototypes, box, where)
        for row, box in zip(rows[some], corners, strict=True)
    ]
    box = np.clip(where.boxes_out(corners), 0, np.tile(where.original[::-1], 2)).astype(np.float32)
    return Raw(box, np.ascontiguousarray(score[some]), masks)


def _corners(boxes: NDArray[np.float32], kind: str) -> NDArray[np.float32]:
    """Boxes (n, 4) as x0, y0, x1, y1 px of the canvas."""
    if kind == "corners":
        return boxes
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], 1)


def _mask(
    coefficients: NDArray[np.float32], prototypes: NDArray[np.float32], box: NDArray[Any], where: Geometry
) -> NDArray[np.bool_]:
    """(H, W): logits at the size of the canvas, nothing outside the box, cut to the frame, then > 0.

    Upsampled as logits: a mask that is cut first has the stairs of the coarse grid.
    """
    logits = np.tensordot(coefficients, prototypes, 1)
    full = cv2.resize(logits, where.canvas[::-1], interpolation=cv2.INTER_LINEAR)
    x0, y0, x1, y1 = np.clip(np.rint(box), 0, np.tile(where.canvas[::-1], 2)).astype(int)
    inside = np.full_like(full, -1.0)
    inside[y0:y1, x0:x1] = full[y0:y1, x0:x1]
    return np.asarray(where.map_out(inside) > 0)
