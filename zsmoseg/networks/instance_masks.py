"""Instance masks of a network in one go: boxes, scores of categories, and masks from prototypes and coefficients.

Source: Bolya et al., "YOLACT: real-time instance segmentation", ICCV 2019, for masks as products of prototypes and
coefficients; the tensors are those of the YOLOv8 family.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from zsmoseg.errors import ModelError
from zsmoseg.networks.batches import run_frames
from zsmoseg.networks.boxes import suppress
from zsmoseg.networks.categories import COCO
from zsmoseg.networks.contract import NAME, Contract, Table
from zsmoseg.networks.image import Frame, Geometry
from zsmoseg.networks.session import Network


class Instances(Table):
    """The table ``[instances]`` of a contract."""

    categories: list[str] | Literal["coco"] | None = None
    scores: Literal["probabilities", "logits"] = "probabilities"
    boxes: Literal["centre-size", "corners"] = "centre-size"
    floor: float = Field(0.1, ge=0, lt=1)
    """Best score of a category from which a candidate is kept: thresholds act above it."""
    most: int = Field(100, ge=1, le=10000)
    """Candidates of a frame that are kept, the best first."""
    overlap: float = Field(0.7, gt=0, le=1)
    """Intersection over union of boxes from which the lower score is the same thing."""


@dataclass(frozen=True)
class Raw:
    """The candidates of a frame, before thresholds: box (n, 4) x0, y0, x1, y1 px of the frame, score (n, categories)."""

    box: NDArray[np.float32]
    score: NDArray[np.float32]
    mask: list[NDArray[np.bool_]]
    """n of (H, W)."""


def categories_of(contract: Contract) -> list[str]:
    """The names of the categories; none where the contract gives none."""
    named = contract.extra("instances", Instances).categories
    if named is None and any("coco" in output.meaning.lower() for output in contract.output):
        named = "coco"
    return list(COCO) if named == "coco" else list(named or [])


def network_instances(network: Network, frames: Iterable[Frame], most: int = 1) -> Iterator[Raw]:
    """The candidates of frames (H, W, 3), blue green red, best first.

    Parameters
    ----------
    most
        Frames at once (``run_frames``).

    Raises
    ------
    ModelError
        The tensors have not the shapes of boxes, scores and coefficients.
    """
    for outputs, where in run_frames(network, frames, ["predictions", "prototypes"], most):
        yield _candidates(network.contract, outputs["predictions"][0].T, outputs["prototypes"][0], where)


def _candidates(
    contract: Contract, rows: NDArray[np.float32], prototypes: NDArray[np.float32], where: Geometry
) -> Raw:
    """Of one frame; rows (n, 4 + categories + coefficients)."""
    rules = contract.extra("instances", Instances)
    names, classes = categories_of(contract), rows.shape[1] - 4 - len(prototypes)
    if classes < 1 or (names and len(names) != classes):
        raise ModelError(
            f"{contract.folder / NAME}: predictions have {rows.shape[1]} numbers a candidate, 4 of a box and "
            f"{len(prototypes)} coefficients among them, which leaves {classes} categories; it names {len(names)}"
        )
    as_logits = rules.scores == "logits"
    # the largest along the axis that is contiguous in memory: thousands of candidates, of which a few are left
    best = rows.T[4 : 4 + classes].max(0)
    some = np.flatnonzero(best > (scipy.special.logit(rules.floor) if as_logits else rules.floor))
    corners = _corners(rows[some, :4], rules.boxes)
    kept = suppress(corners, best[some], rules.overlap)[: rules.most]
    some, corners = some[kept], corners[kept]
    flat = rows[some, 4 + classes :] @ prototypes.reshape(len(prototypes), -1)
    logits = flat.reshape(-1, *prototypes.shape[1:])
    score = np.ascontiguousarray(rows[some, 4 : 4 + classes])
    box = np.clip(where.boxes_out(corners), 0, np.tile(where.original[::-1], 2)).astype(np.float32)
    masks = [_mask(one, corners, where) for one, corners in zip(logits, box, strict=True)]
    return Raw(box, scipy.special.expit(score) if as_logits else score, masks)


def _corners(boxes: NDArray[np.float32], kind: str) -> NDArray[np.float32]:
    """Boxes (n, 4) as x0, y0, x1, y1 px of the canvas."""
    if kind == "corners":
        return boxes
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], 1)


def _mask(logits: NDArray[np.float32], box: NDArray[Any], where: Geometry) -> NDArray[np.bool_]:
    """(H, W): logits of the coarse grid at the pixels of the frame within the box (4) of it, then > 0.

    Upsampled as logits: a mask that is cut first has the stairs of the coarse grid. In one step, grid to frame, and
    only where the box is: most boxes are small, and this is most of what a frame costs beside the network.
    """
    mask = np.zeros(where.original, np.bool_)
    x0, y0, x1, y1 = (int(n) for n in np.rint(box))
    if x1 <= x0 or y1 <= y0:
        return mask
    grid = np.array([logits.shape[1] / where.canvas[1], logits.shape[0] / where.canvas[0]])
    scale = np.array(where.scale) * grid
    # the centre of pixel x of the frame lies at (x + 1/2) scale + left on the canvas, and grids have half pixels too
    shift = (np.array([x0, y0]) + 0.5) * scale + np.array([where.left, where.top]) * grid - 0.5
    to_grid = np.array([[scale[0], 0, shift[0]], [0, scale[1], shift[1]]])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    part = cv2.warpAffine(logits, to_grid, (x1 - x0, y1 - y0), flags=how, borderMode=cv2.BORDER_REPLICATE)
    mask[y0:y1, x0:x1] = part > 0
    return mask
