"""The forms in which SAM and its relatives are exported: points with labels in, low-resolution logits out.

Points are in pixels of the canvas. Labels are SAM's (Kirillov et al., ICCV 2023): 1 on the object, 0 off it, 2 and 3
the corners of a box, -1 nothing. All forms give logits (n, m, h, w) and predicted IoU (n, m).

=================  ===============================================================================================
``sam``            Meta's decoder, samexporter's SAM 2 and EdgeSAM: ``points`` (n, p, 2), ``labels`` (n, p) float
``transformers``   Hugging Face's ``prompt_encoder_mask_decoder``: ``points`` (1, n, p, 2), ``labels`` (1, n, p)
``efficient-sam``  EfficientSAM, picture and points in one graph: as ``transformers``, or labels (1, n, p, 1)
=================  ===============================================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import MAIN, Table
from zsmoseg.networks.image import Geometry
from zsmoseg.networks.session import Network

Floats = NDArray[np.float32]
Arrays = dict[str, NDArray[np.generic]]
Decoded = tuple[Floats, Floats]
FULL = 1024
"""px that EfficientSAM stretches every picture to, both ways."""
SINGLE, THREE = 4, 3
"""Masks that a decoder gives: its single mask before the three of several, or the three alone."""


class MasksTable(Table):
    """``[masks]`` of a contract.

    Attributes
    ----------
    style : form of the decoder, see the top of this file.
    boxes_per_call : boxes, or points of a grid, that a call of the decoder takes.
    passes : 2 gives the best logits back with the box, as SAM-Track does.
    pad_point : a point without a box is followed by one of label -1, as SAM was trained; false where the graph does
        that itself; EfficientSAM's always does.
    upsample : ``canvas``: logits grow to the canvas, then to the frame (SAM); ``frame``: in one step (SAM 2).
    """

    style: Literal["sam", "transformers", "efficient-sam"]
    boxes_per_call: int = Field(1, ge=1)
    passes: Literal[1, 2] = 1
    pad_point: bool = True
    upsample: Literal["canvas", "frame"] = "canvas"

    @model_validator(mode="after")
    def _one_way(self) -> MasksTable:
        if self.passes == 2 and self.style != "sam":
            raise ValueError('passes = 2 needs style = "sam", whose decoder takes logits back')
        return self


@dataclass(frozen=True)
class Embedding:
    """What a decoder reads of a frame.

    Attributes
    ----------
    arrays : by role: what the encoder made, or the picture where there is one graph.
    geometry : from the frame to the canvas and back.
    """

    arrays: Arrays
    geometry: Geometry


def decode(network: Network, embedding: Embedding, points: Floats, labels: NDArray[np.int64]) -> Decoded:
    """Logits and predicted IoU of prompts.

    Parameters
    ----------
    network : of task ``box-masks``.
    points : (n, p, 2) x, y in pixels of the canvas; a prompt is one object.
    labels : (n, p).

    Returns
    -------
    logits : (n, m, h, w) at the decoder's resolution; the m answers to a prompt of several possible objects,
        or one.
    quality : (n, m) predicted IoU.
    """
    table = network.contract.extra("masks", MasksTable)
    logits, quality = STYLES[table.style](network, embedding, points, labels, None)
    if table.passes == 2:
        best = quality.argmax(1)
        back = np.take_along_axis(logits, best[:, None, None, None], 1)
        logits, quality = STYLES[table.style](network, embedding, points, labels, back)
    return logits, quality


def _sam(
    network: Network, embedding: Embedding, points: Floats, labels: NDArray[np.int64], back: Floats | None
) -> Decoded:
    """No point is added to a box: with one, Meta's single-mask graphs would choose another mask."""
    feeds: Arrays = {**embedding.arrays, "points": points, "labels": labels.astype(np.float32)}
    roles = network.inputs("decoder")
    if "mask_input" in roles:
        height, width = (int(side) for side in network.shape("decoder", "mask_input")[2:])
        given = np.zeros((len(points), 1, height, width), np.float32) if back is None else back
        feeds |= {"mask_input": given, "has_mask_input": np.full(len(points), back is not None, np.float32)}
        # The graph also grows its masks to this size, which nobody reads: let it be small.
        feeds["orig_im_size"] = np.array([height, width], np.float32)
    elif back is not None:
        raise ModelError(f"{network.contract.name}: passes = 2, but the decoder has no input mask_input")
    return _answers(network, "decoder", feeds)


def _transformers(
    network: Network, embedding: Embedding, points: Floats, labels: NDArray[np.int64], back: Floats | None
) -> Decoded:
    feeds: Arrays = {**embedding.arrays, "points": points[None], "labels": labels[None]}
    if "boxes" in network.inputs("decoder"):
        feeds["boxes"] = points.reshape(1, len(points), -1)
    return _answers(network, "decoder", feeds)


def _efficient_sam(
    network: Network, embedding: Embedding, points: Floats, labels: NDArray[np.int64], back: Floats | None
) -> Decoded:
    """Slots of a fixed number of points that stay empty lie where the authors' code puts them: their place counts."""
    shape = network.shape(MAIN, "labels")
    if isinstance(shape[2], int):
        more = shape[2] - points.shape[1]
        if more < 0:
            raise ModelError(f"{network.contract.name} takes {shape[2]} points, a box has {points.shape[1]}")
        height, width = embedding.geometry.canvas
        # -1 at the size that the network works at
        nowhere = np.array([-width / FULL, -height / FULL], np.float32)
        points = np.concatenate([points, np.broadcast_to(nowhere, (len(points), more, 2))], 1)
        labels = np.pad(labels, ((0, 0), (0, more)), constant_values=-1)
    shaped = labels[None].astype(np.float32)
    shaped = shaped[..., None] if len(shape) == 4 else shaped
    return _answers(network, MAIN, {**embedding.arrays, "points": points[None], "labels": shaped})


STYLES: dict[str, Callable[[Network, Embedding, Floats, NDArray[np.int64], Floats | None], Decoded]] = {
    "sam": _sam,
    "transformers": _transformers,
    "efficient-sam": _efficient_sam,
}


def _answers(network: Network, graph: str, feeds: Arrays) -> Decoded:
    """Run with what the graph has inputs for; of four masks the first, for prompts without a doubt, goes."""
    given = {role: feeds[role] for role in network.inputs(graph) if role in feeds}
    out = network.run(graph, given, ["logits", "quality"])
    logits, quality = np.asarray(out["logits"], np.float32), np.asarray(out["quality"], np.float32)
    count = quality.shape[-1]
    logits = logits.reshape(-1, count, *logits.shape[-2:])
    quality = quality.reshape(-1, count)
    first = SINGLE - THREE if count == SINGLE else 0
    return logits[:, first:], quality[:, first:]
