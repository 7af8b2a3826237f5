"""PWC-Net from weights in the naming of its PyTorch port: one frame's pyramid is warped onto the other's and compared.

Sun, Yang, Liu, Kautz, "PWC-Net: CNNs for Optical Flow Using Pyramid, Warping, and Cost Volume", CVPR 2018 (the paper's
flow). Written from the article and its table of layers; the weights are the authors' and not for commercial use.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    fill,
    load_weights,
    noise,
    verified_dynamic,
    write_contract,
)

CHANNELS = (16, 32, 64, 96, 128, 196)
"""Of the pyramid's levels 1 to 6, each half as large as the one before."""
DECODER = (128, 128, 96, 64, 32)
REFINER = ((128, 1), (128, 2), (128, 4), (96, 8), (64, 16), (32, 1), (2, 1))
"""Channels and dilation of the layers that refine the finest flow."""
RADIUS = 4
"""px that the cost volume reaches to each side: 9 x 9 = 81 shifts."""
WARPS = {5: 0.625, 4: 1.25, 3: 2.5, 2: 5.0}
"""px of a level that one unit of its flow is: 20 / 2^level."""
UNIT = 20.0
"""px of the input that one unit of the flow is."""
WHOLE = 0.999
"""Warped values count where all four neighbours lie in the picture, but for rounding."""
NAMES = ("One", "Two", "Thr", "Fou", "Fiv", "Six")
"""How the port numbers levels and layers."""
EXAMPLE, SECOND = (128, 192), (192, 128)
"""Sizes of the export and of its comparison; any multiple of 64 then runs."""


def export_pwc_net(checkpoint: Path, folder: Path, name: str = "pwc-net") -> Path:
    """Graph and contract of PWC-Net; returns the contract's path.

    Parameters
    ----------
    checkpoint
        ``network-default.pytorch`` or ``network-chairs-things.pytorch`` (names beginning with ``module`` or ``net``).

    Raises
    ------
    ModelError
        The file is no weights of PWC-Net, or the graph gives other values than torch.
    """
    network = pwc_net(load_weights(checkpoint), checkpoint)
    path = folder / f"{name}.onnx"
    free = {0: "batch", 2: "height", 3: "width"}
    axes = {"first": free, "second": free, "flow": {0: "batch", 2: "quarter_height", 3: "quarter_width"}}
    export_graph(network, _pair(1, EXAMPLE), path, ["first", "second"], ["flow"], axes)
    dynamic, batch = (verified_dynamic(network, path, [_pair(count, SECOND)]) for count in (1, 2))
    return write_contract(folder, _contract(name, path.name, dynamic, batch))


def _pair(count: int, size: tuple[int, int]) -> tuple[Any, Any]:
    return noise(count, size, 0), noise(count, size, 1)


def _contract(name: str, file: str, dynamic: bool, batch: bool) -> dict[str, Any]:
    return {
        "name": name,
        "task": "flow",
        "licence": "CC-BY-NC-SA-4.0",
        "commercial": False,
        "source": "https://github.com/sniklaus/pytorch-pwc",
        "graph": {
            "main": {
                "file": file,
                "inputs": {"first": "first", "second": "second"},
                "outputs": {"flow": "flow"},
            }
        },
        "input": {
            "colour_order": "BGR",
            "scale": 1 / 255,
            "dynamic_verified": dynamic,
            "batch_verified": batch,
            "resize": {
                "rule": "stretch",
                "multiple_of": 64,
                "rounding": "up",
                "interpolation": "linear",
                "on": "float32",
            },
        },
        "output": {"tensor": "flow", "role": "flow", "meaning": "flow in pixels of the resized image"},
    }


def pwc_net(weights: Mapping[str, Any], path: Path) -> Any:
    """The network as a torch module (first, second) -> flow: (1, 3, h, w) blue green red, 0 to 1, sides multiples of 64
    -> (1, 2, h/4, w/4) px of the input.

    Raises
    ------
    ModelError
        If ``weights``, read from ``path``, are not those of PWC-Net.
    """
    parts = fill(_parts(), {_ported(name): value for name, value in weights.items()}, path)
    return as_module(lambda first, second: _flow(parts, first, second) * UNIT, parts)


def _ported(name: str) -> str:
    """The newer of the two namings of the same port."""
    return ".".join(
        "net" + part.removeprefix("module") if part.startswith("module") else part for part in name.split(".")
    )


# -------------------------------------------------------------------------- layers
def _parts() -> Any:
    """All weights, named as in the port: 9.4 million numbers."""
    from torch.nn import ModuleDict

    before = (3, *CHANNELS)
    pyramid = {
        f"net{name}": _block((before[i], 2, 1), (channels, 1, 1), (channels, 1, 1), out=channels)
        for i, (name, channels) in enumerate(zip(NAMES, CHANNELS, strict=True))
    }
    decoders = {f"net{NAMES[level - 1]}": _decoder(level) for level in (2, 3, 4, 5, 6)}
    inside = (_features(2) + sum(DECODER), *(channels for channels, _ in REFINER))
    steps = [(inside[i], 1, dilation) for i, (_, dilation) in enumerate(REFINER)]
    refiner = _block(*steps, out=REFINER[-1][0], last=False)
    return ModuleDict(
        {
            "netExtractor": ModuleDict(pyramid),
            **decoders,
            "netRefiner": ModuleDict({"netMain": refiner}),
        }
    )


def _block(*layers: tuple[int, int, int], out: int, last: bool = True) -> Any:
    """Convolutions of 3 x 3 (channels in, stride, dilation), each with a leaky ReLU, the last one's on demand."""
    from torch.nn import Conv2d, LeakyReLU, Sequential

    after = [channels for channels, _, _ in layers[1:]] + [out]
    chain: list[Any] = []
    for (channels, stride, dilation), following in zip(layers, after, strict=True):
        chain += [Conv2d(channels, following, 3, stride, padding=dilation, dilation=dilation), LeakyReLU(0.1)]
    return Sequential(*(chain if last else chain[:-1]))


def _features(level: int) -> int:
    """Channels that a decoder begins with: the cost volume; below the coarsest also features, flow and context."""
    volume = (2 * RADIUS + 1) ** 2
    return volume if level == len(CHANNELS) else volume + CHANNELS[level - 1] + 2 + 2


def _decoder(level: int) -> Any:
    """Densely connected: each layer sees all that came before it."""
    from torch.nn import ConvTranspose2d, ModuleDict

    channels, layers = _features(level), {}
    for name, out in zip(NAMES, (*DECODER, 2), strict=True):
        layers[f"net{name}"] = _block((channels, 1, 1), out=out, last=name != "Six")
        channels += out
    if level < len(CHANNELS):
        coarser = _features(level + 1) + sum(DECODER)
        layers["netUpflow"] = ConvTranspose2d(2, 2, 4, 2, 1)
        layers["netUpfeat"] = ConvTranspose2d(coarser, 2, 4, 2, 1)
    return ModuleDict(layers)


# -------------------------------------------------------------------------- what they do
def _flow(parts: Any, first: Any, second: Any) -> Any:
    """(1, 2, h/4, w/4), in units of ``UNIT`` px: from the coarsest level to the second finest."""
    one, two = (_pyramid(parts["netExtractor"], image) for image in (first, second))
    flow = context = None
    for level in (6, 5, 4, 3, 2):
        decoder = parts[f"net{NAMES[level - 1]}"]
        flow, context = _estimate(decoder, level, one[level - 1], two[level - 1], flow, context)
    return flow + parts["netRefiner"]["netMain"](context)


def _pyramid(extractor: Any, image: Any) -> list[Any]:
    levels = []
    for name in NAMES:
        image = extractor[f"net{name}"](image)
        levels.append(image)
    return levels


def _estimate(decoder: Any, level: int, one: Any, two: Any, flow: Any, context: Any) -> tuple[Any, Any]:
    """Flow and context of a level from those of the coarser one."""
    import torch
    from torch.nn.functional import leaky_relu

    if flow is None:
        known = leaky_relu(correlation(one, two), 0.1)
    else:
        flow, context = decoder["netUpflow"](flow), decoder["netUpfeat"](context)
        volume = leaky_relu(correlation(one, warped(two, flow * WARPS[level])), 0.1)
        known = torch.cat([volume, one, flow, context], 1)
    for name in NAMES[:-1]:
        known = torch.cat([decoder[f"net{name}"](known), known], 1)
    return decoder["netSix"](known), known


def correlation(one: Any, two: Any) -> Any:
    """(n, 81, h, w): the mean over channels of ``one`` times ``two`` shifted by (dy, dx), dy first; zero outside.

    A row of shifts at a time: all 81 at once take 81 copies of the features. Slices, for what ``unfold`` becomes in ONNX
    gathers number by number.
    """
    import torch
    from torch.nn.functional import pad

    height, width = one.shape[2:]
    side = 2 * RADIUS + 1
    around = pad(two, (RADIUS, RADIUS, RADIUS, RADIUS))
    rows = []
    for dy in range(side):
        row = around[:, :, dy : dy + height]
        shifted = torch.stack([row[..., dx : dx + width] for dx in range(side)], 2)
        rows.append((one[:, :, None] * shifted).mean(1))
    return torch.cat(rows, 1)


def warped(image: Any, flow: Any) -> Any:
    """``image`` (n, c, h, w) at where ``flow`` (n, 2, h, w) px leads; zero where that is not wholly inside.

    Corner pixels are corners (``align_corners``): the network was trained before torch's default was another.
    """
    import torch
    from torch.nn.functional import grid_sample

    height, width = image.shape[2:]
    x = torch.arange(width).to(image)[None, None, :] + flow[:, 0]
    y = torch.arange(height).to(image)[None, :, None] + flow[:, 1]
    grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
    with_ones = torch.cat([image, torch.ones_like(image[:, :1])], 1)
    found = grid_sample(with_ones, grid, mode="bilinear", padding_mode="zeros", align_corners=True)
    return found[:, :-1] * (found[:, -1:] > WHOLE).to(image)
