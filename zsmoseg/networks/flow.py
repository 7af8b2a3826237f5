"""Flow of a network: from one frame to another, in pixels of the frame, whatever size the network sees."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.errors import ModelError, NetworkError
from zsmoseg.networks.contract import MAIN, NAME, Contract
from zsmoseg.networks.image import Frame, Tensor, prepare
from zsmoseg.networks.session import Network

Flow = NDArray[np.float32]
MEANING = "flow in pixels of the resized image"
"""How the meaning of the output begins: of the image that the network gets, whatever grid it leaves flow on."""


def check_flow(contract: Contract) -> None:
    """Refuse a contract that does not say what its flow is measured in.

    Raises
    ------
    ModelError
        It does not: in other units the motion has a plausible look and the wrong length.
    """
    said = contract.meaning_of("flow").meaning
    if not said.lower().startswith(MEANING):
        raise ModelError(
            f"{contract.folder / NAME}: [output] meaning of the flow is {said or 'missing'}; "
            f'it is "{MEANING}" (x right, y down, from first to second); write into the graph what differs'
        )


def network_flow(network: Network, first: Frame, second: Frame) -> Flow:
    """Flow from ``first`` to ``second``: (2, H, W) float32, x then y, px of the frame.

    Each axis is scaled by how the resize scaled it; padding is cut off and scales nothing. The network's flow may lie
    on a grid of any size over its input (PWC-Net leaves a quarter); it is resized by its own shape, linearly.

    Parameters
    ----------
    first, second
        (H, W, 3) uint8, blue green red.

    Raises
    ------
    ModelError
        The contract says too little, or the graph takes or leaves something else than flow networks do.
    NetworkError
        Something came out that is not finite.
    """
    check_flow(network.contract)
    one, where = prepare(first, network.contract.image)
    two, _ = prepare(second, network.contract.image)
    flow = _field(network.run(MAIN, _feeds(network, one, two), ["flow"])["flow"], network.contract)
    if not np.isfinite(flow).all():
        raise NetworkError(
            f"{network.contract.name}: its flow is not finite; is the input range of its contract right?"
        )
    frame = [where.map_out(part) / np.float32(scale) for part, scale in zip(flow, where.scale, strict=True)]
    return np.stack(frame)


def _feeds(network: Network, one: Tensor, two: Tensor) -> dict[str, Tensor]:
    """Two tensors, or one with the channels of both."""
    taken = set(network.inputs(MAIN))
    if taken == {"first", "second"}:
        return {"first": one, "second": two}
    if taken == {"both"}:
        channels = 1 if network.contract.image.layout == "NCHW" else -1
        return {"both": np.concatenate([one, two], channels)}
    raise ModelError(
        f"{network.contract.folder / NAME}: a flow network takes the roles first and second, or both (six channels); "
        f"this one takes {', '.join(sorted(taken))}: name them in [graph.{MAIN}] inputs"
    )


def _field(found: NDArray[Any], contract: Contract) -> Flow:
    """(2, h, w) of what a network left, channels first or last, with or without a batch of one."""
    field = found[0] if found.ndim == 4 and len(found) == 1 else found
    if field.ndim == 3 and len(field) != 2 and field.shape[-1] == 2:
        field = np.moveaxis(field, -1, 0)
    if field.ndim != 3 or len(field) != 2:
        raise ModelError(
            f"{contract.folder / NAME}: the output has shape {list(found.shape)}; flow is two numbers a pixel: choose "
            f"another tensor in [graph.{MAIN}] outputs"
        )
    return np.asarray(field, np.float32)
