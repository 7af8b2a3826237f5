"""A frame as the input of a network, and what comes out of the network back on the frame: one geometry for all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import Image, Resize

Frame = NDArray[np.uint8]
Tensor = NDArray[np.float32]
Size = tuple[int, int]
"""Height and width, px."""

MOST = 2**26
"""px of an input: by its short side an elongated frame grows without bounds."""
CV = {
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "area": cv2.INTER_AREA,
    "nearest": cv2.INTER_NEAREST_EXACT,
}


@dataclass(frozen=True)
class Geometry:
    """Where a frame of size ``original`` lies in the network's input: resized, at (top, left) of the ``canvas``.

    Places are those of pixel edges: x of the frame is x * width / original width + left of the canvas, as in every
    resize with ``align_corners = False``. With ``align_corners`` the centres of the corner pixels coincide instead.
    """

    original: Size
    resized: Size
    canvas: Size
    top: int = 0
    left: int = 0
    align_corners: bool = False

    @property
    def scale(self) -> tuple[float, float]:
        """Pixels of the canvas a pixel of the frame: x, y."""
        return self.resized[1] / self.original[1], self.resized[0] / self.original[0]

    def points_in(self, points: NDArray[Any]) -> NDArray[np.float32]:
        """Places (..., 2) x, y px of the frame as those of the canvas."""
        return (np.asarray(points) * self.scale + (self.left, self.top)).astype(np.float32)

    def boxes_out(self, boxes: NDArray[Any]) -> NDArray[np.float32]:
        """Boxes (n, 4) x0, y0, x1, y1 px of the canvas as those of the frame; they may reach beyond it."""
        corners = (np.reshape(boxes, (-1, 2, 2)) - (self.left, self.top)) / self.scale
        return corners.reshape(-1, 4).astype(np.float32)

    def crop(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of maps (..., h, w) of any size that cover the canvas, the part that shows the frame: no padding."""
        high, wide = values.shape[-2] / self.canvas[0], values.shape[-1] / self.canvas[1]
        rows = _span(self.top * high, (self.top + self.resized[0]) * high, values.shape[-2])
        columns = _span(self.left * wide, (self.left + self.resized[1]) * wide, values.shape[-1])
        return values[..., rows, columns]

    def map_out(
        self, values: NDArray[Any], interpolation: str = "linear", size: Size | None = None
    ) -> Tensor:
        """A map (h, w) of any size that covers the canvas, at the size of the frame or at ``size``."""
        wanted = size or self.original
        if values.shape[-2:] != self.canvas and self.resized != self.canvas:
            # a coarse grid cannot be cut at the edge of the picture: first to the canvas, as SAM's own code does
            values = cv2.resize(
                np.asarray(values, np.float32), self.canvas[::-1], interpolation=CV[interpolation]
            )
        part = np.ascontiguousarray(self.crop(values), np.float32)
        if self.align_corners:
            return aligned(part, wanted)
        return np.asarray(cv2.resize(part, wanted[::-1], interpolation=CV[interpolation]), np.float32)


def _span(first: float, last: float, most: int) -> slice:
    """The places between two edges, one at least."""
    begin = min(round(first), most - 1)
    return slice(begin, max(begin + 1, round(last)))


def aligned(values: NDArray[Any], size: Size) -> Tensor:
    """Maps (..., h, w) at another (height, width): bilinear, the corner pixels stay the corner pixels.

    ``cv2.remap`` would round places to 1/32 px.
    """
    rows, columns = (_weights(before, after) for before, after in zip(values.shape[-2:], size, strict=True))
    down = np.swapaxes(_between(np.swapaxes(values, -1, -2), rows), -1, -2)
    return _between(down, columns)


def _weights(before: int, after: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Tensor]:
    """For each new place the two old ones beside it, and how much of the second."""
    place = np.arange(after) * ((before - 1) / max(after - 1, 1))
    low = np.minimum(place.astype(np.int64), before - 1)
    return low, np.minimum(low + 1, before - 1), (place - low).astype(np.float32)


def _between(values: NDArray[Any], weights: tuple[NDArray[np.int64], NDArray[np.int64], Tensor]) -> Tensor:
    low, high, part = weights
    return np.asarray(values[..., low] * (1 - part) + values[..., high] * part, np.float32)


def geometry(original: Size, rule: Resize) -> Geometry:
    """Where a frame of (height, width) goes."""
    resized = _resized(original, rule)
    canvas = _canvas(resized, rule)
    if math.prod(canvas) > MOST:
        raise ModelError(
            f"the resize rule of the contract makes {canvas[1]} x {canvas[0]} of {original[1]} x {original[0]} px; at "
            f"most {MOST} px go into a network: use long_side, or letterbox"
        )
    top, left = ((c - r) // 2 if rule.pad == "centre" else 0 for c, r in zip(canvas, resized, strict=True))
    return Geometry(original, resized, canvas, top, left, rule.align_corners)


def _resized(original: Size, rule: Resize) -> Size:
    height, width = original
    if rule.rule == "none":
        return original
    if rule.rule == "stretch":
        if rule.height and rule.width:
            return rule.height, rule.width
        return _rounded(height, rule), _rounded(width, rule)
    if rule.rule == "letterbox":
        high, wide = rule.height or rule.long_side, rule.width or rule.long_side
        assert high is not None
        assert wide is not None
        scale = min(high / height, wide / width)
        return min(high, max(1, round(height * scale))), min(wide, max(1, round(width * scale)))
    if rule.rule == "short-side":
        assert rule.short_side is not None
        scale = rule.short_side / min(original)
        if rule.long_side and max(original) * scale > rule.long_side:
            scale = rule.long_side / max(original)
            return _rounded(height * scale, rule), _rounded(width * scale, rule)
        least = rule.short_side if rule.multiple_of > 1 else 1
        return max(least, _rounded(height * scale, rule)), max(least, _rounded(width * scale, rule))
    assert rule.long_side is not None
    scale = rule.long_side / max(original)
    scale = scale if rule.enlarge else min(scale, 1.0)
    return _rounded(height * scale, rule), _rounded(width * scale, rule)


def _rounded(side: float, rule: Resize) -> int:
    """A side as a multiple, plus ``plus``; sides in px, halves go up as in most networks' own code."""
    steps = (side - rule.plus) / rule.multiple_of
    # what a product of floats missed by its last digits is the number itself
    whole = {
        "nearest": math.floor(steps + 0.5),
        "up": math.ceil(steps - 1e-6),
        "down": math.floor(steps + 1e-6),
    }
    return max(1, whole[rule.rounding]) * rule.multiple_of + rule.plus


def _canvas(resized: Size, rule: Resize) -> Size:
    if rule.pad == "none":
        return resized
    if rule.height and rule.width and rule.rule != "stretch":
        return max(rule.height, resized[0]), max(rule.width, resized[1])
    if rule.long_side and rule.rule in ("long-side", "letterbox") and rule.multiple_of == 1:
        return rule.long_side, rule.long_side
    up = rule.model_copy(update={"rounding": "up"})
    return _rounded(resized[0], up), _rounded(resized[1], up)


def prepare(frame: Frame, image: Image) -> tuple[Tensor, Geometry]:
    """A frame (H, W, 3), blue green red, as the tensor (1, 3, h, w) that a contract asks for; HWC: (h, w, 3).

    The order of the steps is that of the networks' own code: resize, order of colours, scale, mean, deviation; padding
    with a pixel value is part of the picture, padding without one is zero behind all that.
    """
    where = geometry((frame.shape[0], frame.shape[1]), image.resize)
    values: NDArray[Any] = _scaled(frame, where, image.resize)
    if image.resize.pad_value is not None:
        values = _padded(values, where, image.resize, image.resize.pad_value)
    planes = _normalised(values, image)
    if image.resize.pad_value is None:
        planes = _padded(planes.transpose(1, 2, 0), where, image.resize, [0.0, 0.0, 0.0]).transpose(2, 0, 1)
    if image.dtype == "uint8":
        planes = np.clip(np.rint(planes), 0, 255)
    if image.layout == "HWC":
        return np.ascontiguousarray(planes.transpose(1, 2, 0), image.dtype), where
    return np.ascontiguousarray(planes, image.dtype)[None], where


def _normalised(values: NDArray[Any], image: Image) -> Tensor:
    """(3, h, w) of (h, w, 3), blue green red: colours in order, (x * scale - mean) / std; plane by plane, which is fast."""
    order = (2, 1, 0) if image.colour_order == "RGB" else (0, 1, 2)
    planes = np.empty((3, *values.shape[:2]), np.float32)
    channels = cv2.split(np.ascontiguousarray(values))
    for plane, channel, mean, std in zip(planes, order, image.mean, image.std, strict=True):
        np.multiply(channels[channel], np.float32(image.scale), out=plane)
        if mean:
            plane -= np.float32(mean)
        if std != 1:
            plane /= np.float32(std)
    return planes


def _scaled(frame: Frame, where: Geometry, rule: Resize) -> NDArray[Any]:
    """(h, w, 3) resized."""
    if where.resized == where.original:
        return frame
    size = where.resized[::-1]
    if rule.interpolation.startswith("antialias"):
        return _antialiased(frame, size, rule)
    source = frame.astype(np.float32) if rule.on == "float32" else frame
    if rule.align_corners:
        return aligned(np.moveaxis(source, 2, 0), where.resized).transpose(1, 2, 0)
    return np.asarray(cv2.resize(source, size, interpolation=CV[rule.interpolation]))


def _antialiased(frame: Frame, size: tuple[int, int], rule: Resize) -> NDArray[Any]:
    """As PIL shrinks: every pixel of the source counts; torchvision's ``antialias`` is the same on numbers."""
    from PIL import Image as Pictures

    how = (
        Pictures.Resampling.BICUBIC if rule.interpolation.endswith("cubic") else Pictures.Resampling.BILINEAR
    )
    if rule.on == "uint8":
        return np.asarray(Pictures.fromarray(frame).resize(size, how))
    planes = [
        Pictures.fromarray(np.ascontiguousarray(frame[..., c], np.float32)).resize(size, how)
        for c in range(3)
    ]
    return np.stack([np.asarray(plane) for plane in planes], -1)


def _padded(values: NDArray[Any], where: Geometry, rule: Resize, value: list[float]) -> NDArray[Any]:
    """(h, w, 3) on its canvas."""
    if where.canvas == where.resized:
        return values
    bottom, right = (
        where.canvas[0] - where.resized[0] - where.top,
        where.canvas[1] - where.resized[1] - where.left,
    )
    mode = cv2.BORDER_REPLICATE if rule.pad_mode == "replicate" else cv2.BORDER_CONSTANT
    # cv2.copyMakeBorder wants a positive-stride array and a scalar a channel
    source = np.ascontiguousarray(values)
    return np.asarray(cv2.copyMakeBorder(source, where.top, bottom, where.left, right, mode, value=value))
