"""A tracker with the graphs of Cutie: pixels in memory, and a summary of each object.

Cheng, Oh, Price, Lee, Schwing, "Putting the object back into video object segmentation", CVPR 2024; what is remembered
when follows the authors' code without its long-term memory. The memory is here; the graphs hold nothing:

- ``encode_key``: image (1, 3, H, W) -> f16, f8, f4, pix_feat, key, shrinkage, selection
- ``encode_value``: image, pix_feat, sensory, mask (1, K, H, W) -> mask_value, new_sensory, object_memory
- ``memory_readout``: query_key, query_selection, memory_key (1, c, T, h, w), memory_shrinkage, memory_value
  (1, K, c, T, h, w), object_memory, pix_feat, sensory, last_mask[, memory_valid] -> memory_readout
- ``decode``: f8, f4, memory_readout, sensory[, f16] -> new_sensory, prob (1, 1 + K, H, W)

The number of objects K is free or 1: then every object is run alone and does not know the others, an approximation. That
of frames T is free or fixed: then places without a frame are marked in ``memory_valid``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from zsmoseg.networks.contract import Table
from zsmoseg.networks.image import Geometry, prepare
from zsmoseg.networks.session import Network
from zsmoseg.tracking.aggregation import aggregated_objects
from zsmoseg.tracking.carrying import Label
from zsmoseg.tracking.protocol import Frame, Step

Real = NDArray[np.float32]
Tensors = dict[str, Real]


class Cutie(Table):
    """``[tracker]`` of a contract."""

    style: Literal["cutie"]
    frames: int = Field(5, ge=1)
    """Frames that are remembered, that of the start among them."""
    every: int = Field(5, ge=1)
    """Frames from one that is remembered to the next."""


@dataclass
class _Together:
    """Objects that came in the same frame, and the frames that are remembered of them."""

    numbers: list[int]
    """Places of these objects in the arrays of all, from 0."""
    first: Tensors
    newest: deque[Tensors]

    def memory(self) -> list[Tensors]:
        """memory_key, memory_shrinkage, memory_value of each frame."""
        return [self.first, *self.newest]


@dataclass
class CutieTracker:
    """See the file."""

    network: Network
    rules: Cutie = field(init=False)
    together: list[_Together] = field(default_factory=list)
    count: int = 0
    """Objects."""
    objects: Tensors = field(default_factory=dict)
    """Of all objects: sensory (1, K, c, h, w), object_memory (1, K, 1, q, c), last_mask (1, K, H, W)."""
    last: Tensors = field(default_factory=dict)
    """The last frame: its image and what ``encode_key`` says of it."""
    where: Geometry | None = None
    since: int = 0
    """Frames since the last one that is remembered."""

    def __post_init__(self) -> None:
        self.rules = self.network.contract.extra("tracker", Cutie)

    def start(self, frame: Frame, label: Label) -> None:
        """Remember the first frame; see ``Tracker``."""
        self.together, self.count, self.objects = [], 0, {}
        self._look(frame)
        self.add(frame, label)

    def add(self, frame: Frame, label: Label) -> None:
        """Remember the last frame with the masks that are given instead of those found; see ``Tracker``."""
        before, self.count = self.count, max(self.count, int(label.max(initial=0)))
        masks = (self._placed(label) == np.arange(1, self.count + 1)[:, None, None]).astype(np.float32)
        self.objects["last_mask"] = aggregated_objects(masks)[None, 1:]
        rows, columns = self.last["pix_feat"].shape[2:]
        channels = int(self.network.shape("encode_value", "sensory")[2])
        fresh = np.zeros((1, self.count - before, channels, rows, columns), np.float32)
        known = self.objects.get("sensory", fresh[:, :0])
        self.objects["sensory"] = np.concatenate([known, fresh], 1)
        self._remember(list(range(before, self.count)))

    def step(self, step: Step) -> Label:
        """See ``Tracker``; the masks go into memory with the next step, unless better ones are added before."""
        return np.asarray(self.probability(step.frame).argmax(0), np.uint16)

    def probability(self, frame: Frame) -> Real:
        """(1 + objects, H, W) of the next frame, the background first."""
        if self.since >= self.rules.every:
            self._remember([])
        self._look(frame)
        readout = np.zeros_like(self.objects["sensory"])
        for some in self.together:
            readout[:, some.numbers] = self._read(some)
        decoded = self._run(
            "decode", {**self.last, "memory_readout": readout, "sensory": self.objects["sensory"]}
        )
        self.objects["sensory"] = decoded["new_sensory"]
        self.objects["last_mask"] = decoded["prob"][:, 1:]
        self.since += 1
        assert self.where is not None
        inside = self.where.crop(decoded["prob"][0])
        if inside.shape[1:] == self.where.original:
            return np.asarray(inside)
        return np.stack([self.where.map_out(p) for p in decoded["prob"][0]])

    def remembered(self) -> int:
        """Frames in memory, over all objects that came together."""
        return sum(len(some.memory()) for some in self.together)

    # -------------------------------------------------------------------- memory
    def _look(self, frame: Frame) -> None:
        image, self.where = prepare(frame, self.network.contract.image)
        self.last = {"image": image, **self.network.run("encode_key", {"image": image})}

    def _remember(self, fresh: list[int]) -> None:
        """The last frame with its last masks; for the objects ``fresh`` it is their first."""
        mask, sensory = self.objects["last_mask"], self.objects["sensory"]
        found = self._run("encode_value", {**self.last, "sensory": sensory, "mask": mask})
        self.objects["sensory"] = found["new_sensory"]
        summary = found["object_memory"][:, :, None]
        if (before := self.objects.get("object_memory")) is not None:
            summary[:, : before.shape[1]] += before
        self.objects["object_memory"] = summary
        for some in self.together:
            some.newest.append(self._frame(some.numbers, found["mask_value"]))
        if fresh:
            first = self._frame(fresh, found["mask_value"])
            self.together.append(_Together(fresh, first, deque(maxlen=self.rules.frames - 1)))
        self.since = 0

    def _frame(self, numbers: Sequence[int], value: Real) -> Tensors:
        return {
            "memory_key": self.last["key"],
            "memory_shrinkage": self.last["shrinkage"],
            "memory_value": value[:, list(numbers)],
        }

    def _read(self, some: _Together) -> Real:
        """(1, K, c, h, w) what memory says of objects that came together."""
        frames = some.memory()
        feeds = {
            "query_key": self.last["key"],
            "query_selection": self.last["selection"],
            "pix_feat": self.last["pix_feat"],
            **{name: array[:, some.numbers] for name, array in self.objects.items()},
            **{name: np.stack([f[name] for f in frames], -3) for name in frames[0]},
        }
        slots = self.network.shape("memory_readout", "memory_key")[2]
        valid = np.broadcast_to(self._inside(), (1, 1, len(frames), *self.last["key"].shape[2:]))
        feeds["memory_valid"] = np.array(valid, np.float32)
        if isinstance(slots, int):
            for name in ("memory_key", "memory_shrinkage", "memory_value", "memory_valid"):
                feeds[name] = _filled(feeds[name], slots)
        return self._run("memory_readout", feeds)["memory_readout"]

    def _inside(self) -> NDArray[np.bool_]:
        """(h, w) whether the middle of a cell shows the frame, not the border around it."""
        assert self.where is not None
        rows, columns = self.last["key"].shape[2:]
        cell = self.where.canvas[0] // rows
        y, x = np.mgrid[:rows, :columns] * cell + cell // 2
        (height, width), top, left = self.where.resized, self.where.top, self.where.left
        return np.asarray((y >= top) & (y < top + height) & (x >= left) & (x < left + width))

    def _placed(self, label: Label) -> Label:
        """(H, W) a label of the frame on the canvas of the network."""
        assert self.where is not None
        (height, width), canvas = self.where.resized, np.zeros(self.where.canvas, np.uint16)
        small = label if label.shape == (height, width) else cv2.resize(
            label, (width, height), interpolation=cv2.INTER_NEAREST_EXACT
        )  # fmt: skip
        canvas[self.where.top : self.where.top + height, self.where.left : self.where.left + width] = small
        return canvas

    # -------------------------------------------------------------------- graphs
    def _run(self, graph: str, feeds: Tensors) -> Tensors:
        """All objects at once, or one after the other where the graph has place for one."""
        taken = {role: feeds[role] for role in self.network.inputs(graph) if role in feeds}
        if self.network.shape(graph, "sensory")[1] != 1:
            return self.network.run(graph, taken)
        each = [
            self.network.run(graph, {r: _one(r, v, k) for r, v in taken.items()})
            for k in range(feeds["sensory"].shape[1])
        ]
        joined = {r: np.concatenate([e[r] for e in each], 1) for r in each[0] if r != "prob"}
        if "prob" in each[0]:
            joined["prob"] = aggregated_objects(np.concatenate([e["prob"][0, 1:] for e in each]))[None]
        return joined


OF_OBJECTS = ("sensory", "mask", "last_mask", "memory_value", "object_memory", "memory_readout")
"""What has an axis of objects."""


def _one(role: str, value: Real, k: int) -> Real:
    return np.ascontiguousarray(value[:, k : k + 1]) if role in OF_OBJECTS else value


def _filled(value: Real, slots: int) -> Real:
    """(..., T, h, w) with as many frames as the graph has places for."""
    room = [(0, 0)] * value.ndim
    room[-3] = (0, slots - value.shape[-3])
    return np.pad(value, room)
