"""DPT on DINOv2 from a folder of transformers: depth in metres of the rooms or streets that it was trained on.

Ranftl, Bochkovskiy, Koltun, "Vision Transformers for Dense Prediction", ICCV 2021, on the features of Oquab et al.,
"DINOv2: Learning Robust Visual Features without Supervision", TMLR 2024 (the paper's depth).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    load_folder,
    noise,
    require,
    verified_dynamic,
    write_contract,
)

MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
"""Of ImageNet, RGB from 0 to 1."""
EXAMPLE, SECOND = (11, 15), (16, 11)
"""Sizes of the export and of its comparison, in patches."""


def export_dpt_dinov2(source: Path, folder: Path, name: str = "dpt-dinov2") -> Path:
    """Graph and contract of DPT on DINOv2; returns the contract's path.

    Frames keep their size and are padded around to whole patches, as the authors do. The output has another size than
    the input (32 px for two patches): it covers the padded frame all the same.

    Parameters
    ----------
    source
        Folder with ``config.json`` and ``model.safetensors`` of ``facebook/dpt-dinov2-*``.

    Raises
    ------
    ModelError
        The folder holds another model, or the graph gives other values than torch.
    """
    require("transformers")
    from transformers import DPTForDepthEstimation

    model = load_folder(DPTForDepthEstimation, source)
    backbone = getattr(model.config.backbone_config, "model_type", None)
    if backbone != "dinov2":
        raise ModelError(f"{source}: its backbone is {backbone or 'a plain ViT'}; wanted dinov2")
    resize = {"rule": "none", "pad": "centre"}
    meaning = "metric-depth in metres, larger = farther; right in scale for what it was trained on"
    network = as_module(lambda image: model(image).predicted_depth, model)
    patch = int(model.config.backbone_config.patch_size)
    licence = {
        "licence": "Apache-2.0",
        "commercial": True,
        "source": "https://github.com/facebookresearch/dinov2",
    }
    return export_depth(network, folder, patch, {"name": name, **licence}, resize, meaning)


def export_depth(
    network: Any,
    folder: Path,
    patch: int,
    about: dict[str, Any],
    resize: dict[str, Any],
    meaning: str,
    align_corners: bool = False,
) -> Path:
    """Graph and contract of a torch module from images (n, 3, h, w), sides whole patches, to depth (n, h', w')."""
    path = folder / f"{about['name']}.onnx"
    example, second = ((rows * patch, columns * patch) for rows, columns in (EXAMPLE, SECOND))
    free = {0: "batch", 2: "height", 3: "width"}
    axes = {"image": free, "depth": {0: "batch", 1: "depth_height", 2: "depth_width"}}
    export_graph(network, [_normalised(1, example)], path, ["image"], ["depth"], axes)
    dynamic, batch = (verified_dynamic(network, path, [[_normalised(count, second)]]) for count in (1, 2))
    content = {
        **about,
        "task": "depth",
        "graph": {"main": {"file": path.name, "inputs": {"image": "image"}, "outputs": {"depth": "depth"}}},
        "input": {
            "colour_order": "RGB",
            "scale": 1 / 255,
            "mean": MEAN,
            "std": STD,
            "dynamic_verified": dynamic,
            "batch_verified": batch,
            "resize": {**resize, "multiple_of": patch},
        },
        "output": {"tensor": "depth", "role": "depth", "meaning": meaning, "align_corners": align_corners},
    }
    return write_contract(folder, content)


def _normalised(count: int, size: tuple[int, int]) -> Any:
    return (noise(count, size) - 0.45) / 0.225
