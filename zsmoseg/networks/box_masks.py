"""Masks of boxes or points: SAM, SAM 2, MobileSAM, EdgeSAM, EfficientSAM.

Logits grow to the size of the frame and are compared with 0 there; a mask that is thresholded first and grown
afterwards has steps. One mask at a time is held as numbers, the others as bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME
from zsmoseg.networks.decoders import Embedding, Floats, MasksTable, decode
from zsmoseg.networks.image import Geometry, prepare
from zsmoseg.networks.session import Network

CORNERS, POINT = (2, 3), (1,)
"""Labels of the corners of a box, and of a point on the object."""
STABLE = 1.0
"""Logits between which an edge may lie: a stable mask has about one area at either (SAM's automatic masks)."""


@dataclass(frozen=True)
class Masks:
    """Masks of one frame.

    Attributes
    ----------
    mask : (n, H, W) the object.
    quality : (n,) IoU with the truth that the network predicts; 0 for a box outside the frame.
    stability : (n,) area above a logit of 1 over the area above -1.
    prompt : (n,) which box or point asked for it.
    """

    mask: NDArray[np.bool_]
    quality: Floats
    stability: Floats
    prompt: NDArray[np.int64]


@dataclass(frozen=True)
class Floors:
    """What masks of a grid of points must reach to be kept at all, below SAM's own 0.88 and 0.95; and how many."""

    quality: float = 0.6
    stability: float = 0.6
    most: int = 300


def embed(network: Network, frame: NDArray[np.uint8]) -> Embedding:
    """What the decoder needs of a frame: one run of the encoder, or the prepared picture where there is none.

    Parameters
    ----------
    network : of task ``box-masks``.
    frame : (H, W, 3) BGR.
    """
    tensor, geometry = prepare(frame, network.contract.image)
    upsample = network.contract.extra("masks", MasksTable).upsample
    if upsample == "frame" and geometry.resized != geometry.canvas:
        raise ModelError(
            f'{network.contract.folder / NAME}: [masks] upsample = "frame" needs a picture that fills the canvas;'
            ' use upsample = "canvas", or no padding'
        )
    if "encoder" not in network.contract.graph:
        return Embedding({"image": tensor}, geometry)
    return Embedding(network.run("encoder", {"image": tensor}), geometry)


def masks_of_boxes(network: Network, embedding: Embedding, boxes: Floats) -> Masks:
    """The best mask of each box, by predicted IoU.

    Parameters
    ----------
    embedding : see :func:`embed`.
    boxes : (n, 4) left, top, right, bottom, px of the frame. What lies outside is cut off; a box that is wholly
        outside gets an empty mask of quality 0.
    """
    geometry = embedding.geometry
    height, width = geometry.original
    boxes = np.clip(boxes, 0, np.array([width, height, width, height])).astype(np.float32)
    inside = np.flatnonzero(((boxes[:, 2:] - boxes[:, :2]) > 0).all(1))
    masks = np.zeros((len(boxes), height, width), bool)
    quality, stability = np.zeros(len(boxes), np.float32), np.zeros(len(boxes), np.float32)
    corners = boxes[inside].reshape(-1, 2, 2)
    for row, logits, predicted in _answers(network, embedding, corners, CORNERS):
        index, best = inside[row], int(predicted.argmax())
        masks[index], stability[index] = _mask(network, logits[best], geometry)
        quality[index] = predicted[best]
    return Masks(masks, quality, stability, np.arange(len(boxes)))


def point_grid(per_side: int, height: int, width: int) -> Floats:
    """(per_side * per_side, 2) x, y of a regular grid of points over a frame, px."""
    steps = (np.arange(per_side, dtype=np.float32) + 0.5) / per_side
    x, y = np.meshgrid(steps * width, steps * height)
    return np.stack([x, y], -1).reshape(-1, 2).astype(np.float32)


def masks_of_points(
    network: Network, embedding: Embedding, points: Floats, floors: Floors = Floors()
) -> Masks:
    """Every mask of each point: what is there, its whole and its part, as SAM segments a picture without a prompt.

    Parameters
    ----------
    embedding : see :func:`embed`.
    points : (n, 2) x, y, px of the frame.
    floors : which masks are kept; the best so many, in the order of the points.
    """
    geometry = embedding.geometry
    found: list[tuple[float, float, int, NDArray[np.bool_]]] = []
    for row, logits, predicted in _answers(network, embedding, points[:, None], POINT):
        for logit, quality in zip(logits, predicted, strict=True):
            if quality < floors.quality:
                continue
            mask, stability = _mask(network, logit, geometry)
            if stability >= floors.stability and mask.any():
                found.append((float(quality), stability, row, mask))
                found = _best(found, floors.most)
    return Masks(
        np.array([mask for *_, mask in found], bool).reshape(-1, *geometry.original),
        np.array([quality for quality, *_ in found], np.float32),
        np.array([stability for _, stability, *_ in found], np.float32),
        np.array([row for *_, row, _ in found], np.int64),
    )


def _best(
    found: list[tuple[float, float, int, NDArray[np.bool_]]], most: int
) -> list[tuple[float, float, int, NDArray[np.bool_]]]:
    """Without the worst where there is one too many; of equals the last goes."""
    if len(found) > most:
        worst = min(range(len(found)), key=lambda i: (found[i][0], -i))
        del found[worst]
    return found


def _answers(
    network: Network, embedding: Embedding, prompts: Floats, labels: tuple[int, ...]
) -> Iterator[tuple[int, Floats, Floats]]:
    """For each prompt (p, 2) in px of the frame: its number, logits (m, h, w), predicted IoU (m,)."""
    table = network.contract.extra("masks", MasksTable)
    for start in range(0, len(prompts), table.boxes_per_call):
        part = prompts[start : start + table.boxes_per_call]
        points = embedding.geometry.points_in(part.reshape(-1, 2)).astype(np.float32).reshape(part.shape)
        named = np.tile(np.array(labels, np.int64), (len(part), 1))
        if labels == POINT and table.pad_point and table.style != "efficient-sam":
            points = np.pad(points, ((0, 0), (0, 1), (0, 0)))
            named = np.pad(named, ((0, 0), (0, 1)), constant_values=-1)
        logits, quality = decode(network, embedding, points, named)
        for row in range(len(part)):
            yield start + row, logits[row], quality[row]


def _mask(network: Network, logits: Floats, geometry: Geometry) -> tuple[NDArray[np.bool_], float]:
    """(H, W) mask of the frame and its stability."""
    upsample = network.contract.extra("masks", MasksTable).upsample
    full = logits_of_frame(logits, geometry, upsample)
    wide = np.count_nonzero(full > -STABLE)
    return full > 0, np.count_nonzero(full > STABLE) / wide if wide else 0.0


def logits_of_frame(logits: Floats, geometry: Geometry, upsample: str) -> Floats:
    """Logits (h, w) over the canvas as logits (H, W) of the frame.

    Parameters
    ----------
    upsample : ``canvas``: bilinear to the canvas, cut to the picture, bilinear to the frame (SAM's
        ``postprocess_masks``); ``frame``: bilinear in one step, where the picture fills the canvas (SAM 2).
    """
    height, width = geometry.original if upsample == "frame" else geometry.canvas
    full = np.asarray(cv2.resize(logits, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    return full if upsample == "frame" else geometry.map_out(full)
