"""Depth Anything from a folder of transformers: inverse depth up to scale and shift; metres in its metric variants.

Yang et al., "Depth Anything V2", NeurIPS 2024: the head of DPT on DINOv2, trained on labels of a larger network.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import MethodType
from typing import Any

from zsmoseg.networks.export.common import as_module, load_folder, require
from zsmoseg.networks.export.dpt_dinov2 import export_depth

SHORT_SIDE = 518
"""px: 37 patches, the size of the training."""
SMALL = 384
"""Channels of ViT-S: only of the small one may the weights be used commercially."""
RELATIVE = "inverse-depth, larger = nearer, up to scale and shift"
METRIC = "metric-depth in metres, larger = farther"


def export_depth_anything(source: Path, folder: Path, name: str = "depth-anything-v2-small") -> Path:
    """Graph and contract of Depth Anything; returns the contract's path.

    Frames are resized as the authors do: shorter side 518 px, sides whole patches, cubic on the numbers.

    Parameters
    ----------
    source
        Folder with ``config.json`` and ``model.safetensors`` of ``depth-anything/Depth-Anything-V2-*-hf``.

    Raises
    ------
    ModelError
        The folder holds another model, or the graph gives other values than torch.
    """
    require("transformers")
    from transformers import DepthAnythingForDepthEstimation

    model = load_folder(DepthAnythingForDepthEstimation, source)
    small = getattr(model.config.backbone_config, "hidden_size", None) == SMALL
    about = {
        "name": name,
        "licence": "Apache-2.0" if small else "CC-BY-NC-4.0",
        "commercial": small,
        "source": "https://github.com/DepthAnything/Depth-Anything-V2",
    }
    resize = {"rule": "short-side", "short_side": SHORT_SIDE, "interpolation": "cubic", "on": "float32"}
    meaning = METRIC if model.config.depth_estimation_type == "metric" else RELATIVE
    return export_depth(dynamic(model), folder, int(model.config.patch_size), about, resize, meaning, True)


def dynamic(model: Any) -> Any:
    """The model as a module whose traced graph follows the size of its input.

    The head of transformers casts the size that it resizes to with ``int``, which tracing turns into the number of
    the example: the graph then runs at every size and always answers in that one. Here the size stays a tensor.
    """
    model.head.forward = MethodType(_head, model.head)
    return as_module(lambda image: model(image).predicted_depth, model)


def _head(head: Any, features: Sequence[Any], rows: Any, columns: Any) -> Any:
    """(n, h, w) of the features of all scales and the numbers of patches down and across."""
    from torch.nn.functional import interpolate

    size = (rows * head.patch_size, columns * head.patch_size)
    full = interpolate(head.conv1(features[head.head_in_index]), size, mode="bilinear", align_corners=True)
    scaled = head.activation2(head.conv3(head.activation1(head.conv2(full)))) * head.max_depth
    return scaled[:, 0]
