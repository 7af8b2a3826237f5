"""A tracker with the graphs of DeAOT: objects are identities, carried from frames in memory to the next one.

Yang, Yang, "Decoupling features in hierarchical propagation for video object segmentation", NeurIPS 2022; what is
remembered when follows the authors' code. The memory is here, in arrays of tokens; the graphs hold nothing:

- ``encode``: image (1, 3, H, W) -> s4, s8, s16 (shortcuts for the decoder), emb
- ``identify``: one_hot (1, 1 + n, H, W) -> identity: what the masks say, a token a cell
- ``reference``: emb, identity -> key, value, id (layers, tokens, channels): a frame whose masks are given
- ``propagate``: s4, s8, s16, emb, long_* and short_* (key, value, id) -> logits (1, 1 + n, H/4, W/4), key, value, context
- ``fuse``: identity[, context] -> id: with key and value, the memory of a frame whose masks were found
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from zsmoseg.networks.contract import Table
from zsmoseg.networks.image import aligned, prepare
from zsmoseg.networks.session import Network
from zsmoseg.tracking.aggregation import aggregated_groups
from zsmoseg.tracking.carrying import Label
from zsmoseg.tracking.protocol import Frame, Step

Real = NDArray[np.float32]
Tokens = tuple[Real, Real, Real]
"""Key, value and id, (layers, tokens, channels) each."""
NEVER = np.float32(-1e10)
"""Logit of an identity that no object has."""


class Deaot(Table):
    """``[tracker]`` of a contract."""

    style: Literal["deaot"]
    objects: int = Field(10, ge=1)
    """Identities, so objects in a group."""
    gap: int = Field(5, ge=1)
    """Frames from one that is remembered for long to the next; 5 in the authors' larger models."""
    frames: int = Field(8, ge=0)
    """Of those, how many are kept: the newest, beside the frames whose masks were given."""


@dataclass
class _Group:
    """Up to ``objects`` objects, and what is remembered of them."""

    given: list[Tokens]
    """The frames whose masks were given: the first, and the last one after it."""
    long: deque[Tokens]
    """The newest of the others that are remembered for long."""
    short: Tokens
    """The frame before."""
    found: tuple[Real, Real, Real] | None = None
    """Key, value and context of the last frame, whose masks are not in them yet."""

    def long_term(self) -> Tokens:
        """All that is remembered for long, one after the other."""
        key, value, identity = (np.concatenate(part, 1) for part in zip(*self.given, *self.long, strict=True))
        return key, value, identity


@dataclass
class DeaotTracker:
    """See the file."""

    network: Network
    rules: Deaot = field(init=False)
    count: int = 0
    """Objects."""
    groups: list[_Group] = field(default_factory=list)
    label: Label = field(default_factory=lambda: np.zeros((0, 0), np.uint16))
    """(H, W) the objects in the last frame."""
    since: int = 0
    """Frames since the last one that is remembered for long."""

    def __post_init__(self) -> None:
        self.rules = self.network.contract.extra("tracker", Deaot)

    def start(self, frame: Frame, label: Label) -> None:
        """Remember the first frame; see ``Tracker``."""
        self.groups, self.count = [], 0
        self.add(frame, label)

    def add(self, frame: Frame, label: Label) -> None:
        """Remember the last frame with the masks that are given instead of those found; see ``Tracker``."""
        image, _ = prepare(frame, self.network.contract.image)
        emb = self.network.run("encode", {"image": image}, ["emb"])["emb"]
        self.count = max(self.count, int(label.max(initial=0)))
        groups = []
        for k, identity in enumerate(self._identities(label, image.shape[2:])):
            found = self.network.run("reference", {"emb": emb, "identity": identity}, ["key", "value", "id"])
            tokens = (found["key"], found["value"], found["id"])
            before = self.groups[k] if k < len(self.groups) else None
            long = deque(maxlen=self.rules.frames) if before is None else before.long
            groups.append(_Group([*before.given[:1], tokens] if before else [tokens], long, tokens))
        self.groups, self.label, self.since = groups, label, 0

    def step(self, step: Step) -> Label:
        """See ``Tracker``; the label goes into memory with the next step, unless a better one is added before."""
        self.label = np.asarray(self.logits(step.frame).argmax(0), np.uint16)
        self.since += 1
        return self.label

    def logits(self, frame: Frame) -> Real:
        """(1 + objects, H, W) of the next frame, the background first."""
        image, _ = prepare(frame, self.network.contract.image)
        self._remember(image.shape[2:])
        encoded = self.network.run("encode", {"image": image})
        groups = [self._propagate(group, encoded, k) for k, group in enumerate(self.groups)]
        return aggregated_groups([aligned(group, frame.shape[:2]) for group in groups])

    def tokens(self) -> int:
        """How many tokens are remembered for long, all groups together."""
        return sum(t[0].shape[1] for group in self.groups for t in (*group.given, *group.long))

    def _propagate(self, group: _Group, encoded: dict[str, Any], k: int) -> Real:
        """(1 + objects, h, w) logits of one group, on the grid of the decoder."""
        names = ("key", "value", "id")
        long = {f"long_{name}": part for name, part in zip(names, group.long_term(), strict=True)}
        short = {f"short_{name}": part for name, part in zip(names, group.short, strict=True)}
        found = self.network.run("propagate", {**encoded, **long, **short})
        group.found = found["key"], found["value"], found["context"]
        logits = np.array(found["logits"][0], np.float32)
        logits[1 + min(self.count - k * self.rules.objects, self.rules.objects) :] = NEVER
        return logits

    def _remember(self, size: Sequence[int]) -> None:
        """Put the masks of the last frame into what is remembered of it."""
        if not self.groups or self.groups[0].found is None:
            return
        taken = self.network.inputs("fuse")
        for group, identity in zip(self.groups, self._identities(self.label, size), strict=True):
            assert group.found is not None
            key, value, context = group.found
            feeds = {"context": context, "identity": identity}
            fused = self.network.run("fuse", {r: feeds[r] for r in feeds if r in taken})["id"]
            group.short, group.found = (key, value, fused), None
            if self.since >= self.rules.gap:
                group.long.append(group.short)
        if self.since >= self.rules.gap:
            self.since = 0

    def _identities(self, label: Label, size: Sequence[int]) -> list[Real]:
        """Of each group what its masks say, at the (height, width) of the network's input."""
        small = cv2.resize(label, (size[1], size[0]), interpolation=cv2.INTER_NEAREST).astype(np.int64)
        found = []
        for first in range(0, max(self.count, 1), self.rules.objects):
            inside = (small > first) & (small <= first + self.rules.objects)
            number = np.where(inside, small - first, 0)
            one_hot = (number == np.arange(self.rules.objects + 1)[:, None, None]).astype(np.float32)
            found.append(self.network.run("identify", {"one_hot": one_hot[None]})["identity"])
        return found
