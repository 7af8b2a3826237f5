"""Our flow of RAFT and PWC-Net against the networks' own code, with random weights, on real frames.

    python tests/parity/flow.py [--pytorch-pwc FOLDER]

Needs torch, torchvision and ezflow. With ``--pytorch-pwc``, a checkout of sniklaus/pytorch-pwc, PWC-Net is compared
with its whole ``estimate``, too. Nothing here can tell whether a network is right about motion: random weights know
none. What is checked is that each step is the reference's; direction and units of flow are in tests/test_networks_flow.
"""

from __future__ import annotations

import argparse
import inspect
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from dense_rows import SIZES, frame, head, network, row

from zsmoseg.networks.export import pwc_net
from zsmoseg.networks.export.pwc_net import export_pwc_net
from zsmoseg.networks.export.raft import export_raft
from zsmoseg.networks.flow import network_flow

Reference = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Two frames (H, W, 3) blue green red to flow (2, H, W)."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pytorch-pwc", type=Path)
    where = parser.parse_args().pytorch_pwc
    torch.manual_seed(0)
    head()
    correlation_is_a_triple_loop()
    warping_by_whole_pixels_is_a_shift()
    with tempfile.TemporaryDirectory() as folder, torch.no_grad():
        raft("small", Path(folder))
        raft("large", Path(folder))
        pwc(Path(folder), where)


# -------------------------------------------------------------------------- RAFT
def raft(size: str, folder: Path) -> None:
    from torchvision.models import optical_flow
    from torchvision.transforms._presets import OpticalFlow

    build = getattr(optical_flow, f"raft_{size}")
    model = build(weights=None, progress=False).eval()
    settle(model)
    checkpoint = folder / f"raft-{size}.pth"
    torch.save(model.state_dict(), checkpoint)
    found = network(export_raft(checkpoint, folder / f"raft-{size}"))

    def reference(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Torchvision's transform and network; the padding is that of the authors' demo."""
        images = [torch.from_numpy(f[..., ::-1].transpose(2, 0, 1).copy())[None] for f in (first, second)]
        one, two = OpticalFlow()(*images)
        height, width = one.shape[-2:]
        down, across = -height % 8, -width % 8
        around = (across // 2, across - across // 2, down // 2, down - down // 2)
        flow = model(*(F.pad(x, around, mode="replicate") for x in (one, two)))[-1][0]
        return flow[:, around[2] : around[2] + height, around[0] : around[0] + width].numpy()

    compare(f"RAFT {size}", "torchvision", found, reference, 1e-3)


def settle(model: Any) -> None:
    """Batch statistics of real frames, as after training: with those of a new network values grow by each layer."""
    for part in model.modules():
        if isinstance(part, torch.nn.BatchNorm2d):
            part.reset_running_stats()
            part.momentum = None
    model.train()
    images = [
        torch.from_numpy(frame(n, (256, 448)).transpose(2, 0, 1).copy())[None] / 127.5 - 1 for n in (0, 1)
    ]
    with torch.no_grad():
        model(*images)
    model.eval()


# -------------------------------------------------------------------------- PWC-Net
def pwc(folder: Path, authors: Path | None) -> None:
    checkpoint = folder / "network-default.pytorch"
    weights = pwc_weights()
    torch.save({name.replace("net", "module"): value for name, value in weights.items()}, checkpoint)
    found = network(export_pwc_net(checkpoint, folder / "pwc-net"))
    model = pwc_net.pwc_net(weights, checkpoint)
    compare("PWC-Net", "own torch module", found, stretched(model), 1e-3)
    other = ezflow_pwc(weights)
    reference = stretched(lambda a, b: other(a, b)["flow_preds"][-1] * 20)
    compare("PWC-Net", "ezflow, its mask 0.9999", found, reference, 0.1)
    with_mask(0.999)
    compare("PWC-Net", "ezflow, mask 0.999", found, reference, 1e-3)
    if authors is not None:
        estimate = port(authors, weights)
        compare("PWC-Net", "pytorch-pwc", found, lambda a, b: estimate(unit(a), unit(b)).numpy(), 1e-3)


def pwc_weights() -> dict[str, Any]:
    """Random weights whose flow is some pixels: He et al.'s for all layers, a part of it for those that leave flow."""
    parts = pwc_net._parts()
    for name, value in parts.state_dict().items():
        if name.endswith("bias"):
            value.normal_(0, 0.02)
        else:
            torch.nn.init.kaiming_normal_(value, a=0.1)
            if ("netSix.0" in name and "Extractor" not in name) or "netMain.12" in name:
                value.mul_(0.1)
    return dict(parts.state_dict())


def unit(image: np.ndarray) -> torch.Tensor:
    """(3, H, W) blue green red, 0 to 1."""
    return torch.from_numpy(image.transpose(2, 0, 1).astype(np.float32) * np.float32(1 / 255))


def stretched(model: Callable[..., Any]) -> Reference:
    """The reference's way around the network, in torch: stretch to multiples of 64, flow back, each axis scaled."""

    def flow(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        height, width = first.shape[:2]
        size = (-(-height // 64) * 64, -(-width // 64) * 64)
        images = [
            F.interpolate(unit(x)[None], size, mode="bilinear", align_corners=False) for x in (first, second)
        ]
        found = F.interpolate(model(*images), (height, width), mode="bilinear", align_corners=False)[0]
        return (found * torch.tensor([width / size[1], height / size[0]])[:, None, None]).numpy()

    return flow


def ezflow_pwc(weights: dict[str, Any]) -> Any:
    """ezflow's PWC-Net with the same weights.

    It differs from the original: the cost volume is a sum over channels, not a mean; what a layer adds stands behind
    the input, not before it; a warped value counts where 0.9999 of its neighbours are inside, not 0.999; the factor
    20 is missing at the end. The first two are undone in the weights, the third by ``with_mask``.
    """
    import ezflow
    from ezflow.config import get_cfg
    from ezflow.models.pwcnet import PWCNet

    config = Path(ezflow.__file__).parent / "model_zoo" / "configs" / "models" / "pwcnet.yaml"
    model = PWCNet(get_cfg(str(config), custom=True)).eval()
    renamed: dict[str, Any] = {}
    for name, value in weights.items():
        renamed[_ezflow_name(name)] = _ezflow_order(name, value) if name.endswith("weight") else value
    model.load_state_dict(renamed)
    return model


def with_mask(threshold: float) -> None:
    """Give ezflow's warp another threshold than its 0.9999."""
    from ezflow.decoder import pyramid

    space: dict[str, Any] = {"torch": torch, "nn": torch.nn}
    exec(inspect.getsource(pyramid.warp).replace("0.9999", str(threshold)), space)
    pyramid.warp = space["warp"]


def _ezflow_name(name: str) -> str:
    first, second, *rest = name.split(".")
    kind = rest[-1]
    if first == "netExtractor":
        return f"encoder.encoder.{pwc_net.NAMES.index(second[3:])}.{int(rest[0]) // 2}.0.{kind}"
    if first == "netRefiner":
        layer = int(rest[0]) // 2
        return f"context_net.context_net.{layer}.{'0.' if layer < 6 else ''}{kind}"
    step = 5 - pwc_net.NAMES.index(first[3:])
    if second == "netUpflow":
        return f"decoder.deconv_layers.{step - 1}.{kind}"
    if second == "netUpfeat":
        return f"decoder.up_feature_layers.{step - 1}.{kind}"
    if second == "netSix":
        return f"decoder.decoder_layers.{step}.to_flow.{kind}"
    return f"decoder.decoder_layers.{step}.decoder.{pwc_net.NAMES.index(second[3:])}.0.{kind}"


def _ezflow_order(name: str, value: Any) -> Any:
    """Weights whose input is the growing stack: what came last stands first in the original, last in ezflow."""
    first, second, *_ = name.split(".")
    if (
        first == "netExtractor"
        or second == "netUpflow"
        or (first == "netRefiner" and ".0.weight" not in name)
    ):
        return value
    level = {"netRefiner": 2}.get(first) or pwc_net.NAMES.index(first[3:]) + 1
    axis = 0 if second == "netUpfeat" else 1
    if second == "netUpfeat":
        level += 1
    base = pwc_net._features(level)
    grown = list(pwc_net.DECODER)
    if second.startswith("net") and second[3:] in pwc_net.NAMES and first != "netRefiner":
        grown = grown[: pwc_net.NAMES.index(second[3:])]
    parts = list(value.split([*grown[::-1], base], axis))
    held = parts.pop().clone()
    held.narrow(axis, 0, 81).div_(pwc_net.CHANNELS[level - 1])
    return torch.cat([held, *parts[::-1]], axis)


def port(folder: Path, weights: dict[str, Any]) -> Callable[..., Any]:
    """``estimate`` of sniklaus/pytorch-pwc: its CUDA cost volume replaced by the definition, its weights by ours."""
    volume = ModuleType("correlation")
    volume.FunctionCorrelation = lambda tenOne, tenTwo: shifted_products(tenOne, tenTwo)  # type: ignore[attr-defined]
    sys.modules["correlation"] = volume
    torch.nn.Module.cuda = lambda self, *_: self  # type: ignore[method-assign, assignment]
    torch.Tensor.cuda = lambda self, *_: self  # type: ignore[method-assign, assignment]
    torch.hub.load_state_dict_from_url = lambda **_: weights  # type: ignore[assignment]
    arguments, sys.argv = sys.argv, sys.argv[:1]
    space: dict[str, Any] = {"__name__": "run"}
    # optimised: without the assertion that refuses every size but 1024 x 436
    exec(compile((folder / "run.py").read_text(), "run.py", "exec", optimize=1), space)
    sys.argv = arguments
    return space["estimate"]


def shifted_products(one: torch.Tensor, two: torch.Tensor) -> torch.Tensor:
    """The cost volume as the article defines it, shift by shift."""
    height, width = one.shape[2:]
    around = F.pad(two, (4, 4, 4, 4))
    shifts = [(dy, dx) for dy in range(9) for dx in range(9)]
    return torch.stack([(one * around[:, :, y : y + height, x : x + width]).mean(1) for y, x in shifts], 1)


# -------------------------------------------------------------------------- pieces of PWC-Net
def correlation_is_a_triple_loop() -> None:
    one, two = torch.randn(2, 1, 5, 6, 7)
    wanted = np.zeros((1, 81, 6, 7))
    for y in range(6):
        for x in range(7):
            for t in range(81):
                v, u = y + t // 9 - 4, x + t % 9 - 4
                if 0 <= v < 6 and 0 <= u < 7:
                    wanted[0, t, y, x] = (one[0, :, y, x] * two[0, :, v, u]).mean()
    row("PWC-Net", "loops over y, x, shift", "cost volume", wanted, pwc_net.correlation(one, two), 1e-6)


def warping_by_whole_pixels_is_a_shift() -> None:
    image = torch.randn(1, 3, 20, 30)
    flow = torch.tensor([4.0, -3.0]).view(1, 2, 1, 1).expand(1, 2, 20, 30)
    wanted = torch.zeros_like(image)
    wanted[:, :, 3:, :-4] = image[:, :, :-3, 4:]
    row("PWC-Net", "shift by (4, -3)", "warp, zero outside", wanted, pwc_net.warped(image, flow), 1e-4)


def compare(model: str, name: str, found: Any, reference: Reference, limit: float) -> None:
    for size in SIZES:
        first, second = frame(10, size), frame(12, size)
        row(
            model,
            name,
            "flow of a frame, px",
            reference(first, second),
            network_flow(found, first, second),
            limit,
        )


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
