"""RAFT from weights of torchvision: all pairs of pixels are compared once, then the flow is updated step by step.

Teed, Deng, "RAFT: Recurrent All-Pairs Field Transforms for Optical Flow", ECCV 2020.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    fill,
    load_weights,
    noise,
    require,
    verified_dynamic,
    write_contract,
)

UPDATES = 12
"""As torchvision runs it; the authors take 20 for a video and 32 for benchmarks."""
EXAMPLE, SECOND = (128, 160), (160, 136)
"""Sizes of the export and of its comparison; sides of 128 or more that are multiples of 8 then run."""


def export_raft(checkpoint: Path, folder: Path, name: str | None = None, updates: int = UPDATES) -> Path:
    """Graph and contract of RAFT, large or small as the weights are; returns the contract's path.

    Frames are padded to multiples of 8 as the authors do: by repeating the border, half on each side.

    Parameters
    ----------
    checkpoint
        State dict of torchvision's ``raft_large`` or ``raft_small``.
    updates
        How often the flow is updated; each is a copy of the update block in the graph.

    Raises
    ------
    ModelError
        The file is no weights of these, or the graph gives other values than torch.
    """
    raft, size = _raft(checkpoint)
    network = as_module(lambda first, second: raft(first, second, num_flow_updates=updates)[-1], raft)
    path = folder / f"{name or f'raft-{size}'}.onnx"
    free = {0: "batch", 2: "height", 3: "width"}
    axes = dict.fromkeys(("first", "second", "flow"), free)
    export_graph(network, _pair(1, EXAMPLE), path, ["first", "second"], ["flow"], axes)
    dynamic, batch = (verified_dynamic(network, path, [_pair(count, SECOND)]) for count in (1, 2))
    return write_contract(folder, _contract(path, dynamic, batch))


def _pair(count: int, size: tuple[int, int]) -> tuple[Any, Any]:
    return noise(count, size, 0) * 2 - 1, noise(count, size, 1) * 2 - 1


def _raft(checkpoint: Path) -> tuple[Any, str]:
    """The network with its weights, and its size: only the large one predicts how to upsample."""
    require("torchvision")
    from torchvision.models.optical_flow import raft_large, raft_small

    weights = load_weights(checkpoint)
    large = any(key.startswith("mask_predictor.") for key in weights)
    build = raft_large if large else raft_small
    return fill(build(weights=None, progress=False), weights, checkpoint), "large" if large else "small"


def _contract(path: Path, dynamic: bool, batch: bool) -> dict[str, Any]:
    return {
        "name": path.stem,
        "task": "flow",
        "licence": "BSD-3-Clause; the data it was trained on is for research",
        "source": "https://github.com/pytorch/vision",
        "graph": {
            "main": {
                "file": path.name,
                "inputs": {"first": "first", "second": "second"},
                "outputs": {"flow": "flow"},
            }
        },
        "input": {
            "colour_order": "RGB",
            "scale": 2 / 255,
            "mean": [1.0, 1.0, 1.0],
            "dynamic_verified": dynamic,
            "batch_verified": batch,
            "resize": {"rule": "none", "multiple_of": 8, "pad": "centre", "pad_mode": "replicate"},
        },
        "output": {"tensor": "flow", "role": "flow", "meaning": "flow in pixels of the resized image"},
    }
