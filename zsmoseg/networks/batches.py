"""Several frames through a network in one call, where that was verified; fewer where memory is short."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

import numpy as np

from zsmoseg.networks.contract import MAIN
from zsmoseg.networks.image import Frame, Geometry, Tensor, prepare
from zsmoseg.networks.session import Array, Network, OutOfMemory

T = TypeVar("T")


def batches(items: Iterable[T], size: int) -> Iterator[list[T]]:
    """Runs of so many; the last may be shorter."""
    found: list[T] = []
    for item in items:
        found.append(item)
        if len(found) == size:
            yield found
            found = []
    if found:
        yield found


def run_frames(
    network: Network, frames: Iterable[Frame], outputs: list[str], most: int = 1
) -> Iterator[tuple[dict[str, Array], Geometry]]:
    """What the one graph of a model says of frames (H, W, 3): outputs by role, each with a batch of one.

    Parameters
    ----------
    most
        Frames at once; 1 unless the contract says that the batch axis was verified.

    Raises
    ------
    NetworkError
        See ``Network.run``; ``OutOfMemory`` where one frame alone is too much.
    """
    size = most if network.contract.image.batch_verified else 1
    for group in batches(frames, size):
        prepared = [prepare(frame, network.contract.image) for frame in group]
        found = _halved(network, [tensor for tensor, _ in prepared], outputs)
        for one, (_, where) in zip(found, prepared, strict=True):
            yield one, where


def _halved(network: Network, tensors: list[Tensor], outputs: list[str]) -> list[dict[str, Array]]:
    """All in one call, or in halves of it as long as memory is short."""
    try:
        found = network.run(
            MAIN, {"image": tensors[0] if len(tensors) == 1 else np.concatenate(tensors)}, outputs
        )
    except OutOfMemory:
        if len(tensors) == 1:
            raise
        half = len(tensors) // 2
        return _halved(network, tensors[:half], outputs) + _halved(network, tensors[half:], outputs)
    if len(tensors) == 1:
        return [found]
    return [{role: value[k : k + 1] for role, value in found.items()} for k in range(len(tensors))]
