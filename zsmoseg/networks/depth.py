"""Depth of a network: relative inverse depth of a frame, whatever its output means."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zsmoseg.depth.relative import relative
from zsmoseg.errors import ModelError, NetworkError
from zsmoseg.formats.depth import inverse_depth
from zsmoseg.networks.batches import run_frames
from zsmoseg.networks.contract import NAME, Contract
from zsmoseg.networks.image import Frame
from zsmoseg.networks.session import Network

Kind = Literal["depth", "inverse-depth"]
INVERSE = ("inverse-depth", "inverse depth", "relative inverse depth", "disparity")
DEPTH = ("depth", "metric-depth", "metric depth", "relative depth")
"""How the meaning of an output begins."""


def kind_of(contract: Contract) -> Kind:
    """Whether the numbers of a depth network grow with the distance or with nearness.

    Raises
    ------
    ModelError
        The contract does not say: mixed up, parallax gets the wrong sign and nothing fails.
    """
    meaning = contract.meaning_of("depth").meaning.lower()
    if meaning.startswith(INVERSE):
        return "inverse-depth"
    if meaning.startswith(DEPTH):
        return "depth"
    raise ModelError(
        f"{contract.folder / NAME}: [output] meaning is {meaning or 'missing'}; it begins with depth (larger = farther) or "
        "inverse-depth (larger = nearer)"
    )


def network_depth(
    network: Network, frames: Iterable[Frame], size: tuple[int, int], most: int = 1
) -> Iterator[NDArray[np.float32]]:
    """Relative inverse depth of frames (H, W, 3), blue green red, on a grid of (height, width), each of mean 1.

    The output is resized by its own shape: DPT heads leave other sizes than they were given.

    Parameters
    ----------
    most
        Frames at once (``run_frames``).
    """
    kind = kind_of(network.contract)
    for outputs, where in run_frames(network, frames, ["depth"], most):
        found = outputs["depth"]
        if found.ndim < 2 or max(found.shape[:-2], default=1) != 1:
            raise ModelError(
                f"{network.contract.folder / NAME}: its output is {list(found.shape)}; depth is one number a pixel"
            )
        if not found.max() > 0:
            raise NetworkError(
                f"{network.contract.name}: its depth is nowhere above 0; is the input range right?"
            )
        if network.contract.meaning_of("depth").align_corners:
            where = replace(where, align_corners=True)
        full = where.map_out(found.reshape(found.shape[-2:]))
        yield relative(full if kind == "inverse-depth" else inverse_depth(full, kind), size)
