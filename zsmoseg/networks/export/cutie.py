"""Cutie from the user's own weights and the authors' own code, as four graphs and their contract.

The network is built by the package ``cutie`` that the user has installed; here are the cuts between graphs, and three
steps in forms that can be traced for any size and any number of objects: pooling to a coarser grid, the places of
cells, and the choice of what a query may look at.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    export_graph,
    fill,
    load_weights,
    modules_of,
    verified_dynamic,
    write_contract,
)

TOP = 30
"""Pixels in memory that a pixel is read from."""
EXAMPLE, SECOND = (96, 128), (128, 80)
"""Sizes of the export and of its comparison; any multiple of 16 then runs."""
NAMES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "encode_key": (("image",), ("f16", "f8", "f4", "pix_feat", "key", "shrinkage", "selection")),
    "encode_value": (
        ("image", "pix_feat", "sensory", "mask"),
        ("mask_value", "new_sensory", "object_memory"),
    ),
    "memory_readout": (
        ("query_key", "query_selection", "memory_key", "memory_shrinkage", "memory_value", "object_memory",
         "pix_feat", "sensory", "last_mask"),
        ("memory_readout",),
    ),
    "decode": (("f8", "f4", "memory_readout", "sensory"), ("new_sensory", "prob")),
}  # fmt: skip
"""Inputs and outputs of every graph."""
MAPS = (
    "image",
    "f16",
    "f8",
    "f4",
    "pix_feat",
    "key",
    "shrinkage",
    "selection",
    "query_key",
    "query_selection",
)
MASKS = ("mask", "last_mask", "prob")


def export_cutie(checkpoint: Path, folder: Path, name: str = "cutie-base-mega") -> Path:
    """Graphs and contract of Cutie's base model; returns the contract's path.

    Raises
    ------
    ModelError
        The authors' code is not installed, the file is no weights of this network, or a graph gives other values than
        torch.
    """
    network = cutie()
    weights = load_weights(checkpoint)
    wanted = network.state_dict()
    training = {k: v for k, v in wanted.items() if k.startswith("aux_computer.")}
    return write_cutie(fill(network, {**training, **weights}, checkpoint), folder, name)


def cutie() -> Any:
    """The authors' base model, with random weights.

    Raises
    ------
    ModelError
        Their code is not installed.
    """
    try:
        model = importlib.import_module("cutie.model.cutie")
        backbones = importlib.import_module("cutie.model.utils.resnet")
        configuration = importlib.import_module("omegaconf").OmegaConf
    except ImportError as error:
        raise ModelError(
            f"the code of Cutie's authors is not there ({error}); pip install omegaconf and "
            "git+https://github.com/hkchengrex/Cutie, or put a checkout of it on PYTHONPATH"
        ) from error
    base = Path(str(model.__file__)).parents[1] / "config" / "model" / "base.yaml"
    config = configuration.create({"model": configuration.load(base)})
    # its backbones would be fetched from the internet, only to be overwritten by the checkpoint
    with (
        patch.object(backbones.model_zoo, "load_url", lambda *_, **__: {}),
        patch.object(backbones, "load_weights_add_extra_dim", lambda *_: None),
    ):
        return model.CUTIE(config).eval()


def write_cutie(network: Any, folder: Path, name: str) -> Path:
    """Graphs and contract of a Cutie that is built and has its weights; returns the contract's path."""
    with _traceable():
        modules = _modules(network)
        dynamic, graphs = [], {}
        first, second = _arguments(modules, EXAMPLE, 2, 2), _arguments(modules, SECOND, 3, 4)
        for graph, module in modules.items():
            path = folder / f"{name}-{graph.replace('_', '-')}.onnx"
            inputs, outputs = NAMES[graph]
            axes = {tensor: _axes(tensor) for tensor in (*inputs, *outputs)}
            export_graph(module, first[graph], path, inputs, outputs, axes)
            dynamic.append(verified_dynamic(module, path, [second[graph]]))
            graphs[graph] = {"file": path.name}
    return write_contract(folder, _contract(name, graphs, all(dynamic)))


def _axes(tensor: str) -> dict[int, str]:
    """What is free in a tensor."""
    if tensor in MAPS:
        return {2: f"{tensor}_rows", 3: f"{tensor}_columns"}
    if tensor in MASKS:
        return {1: "classes" if tensor == "prob" else "objects", 2: "height", 3: "width"}
    if tensor == "object_memory":
        return {1: "objects"}
    if tensor in ("memory_key", "memory_shrinkage"):
        return {2: "frames", 3: "rows", 4: "columns"}
    if tensor == "memory_value":
        return {1: "objects", 3: "frames", 4: "rows", 5: "columns"}
    return {1: "objects", 3: "rows", 4: "columns"}


def _contract(name: str, graphs: dict[str, Any], dynamic: bool) -> dict[str, Any]:
    height, width = (None, None) if dynamic else EXAMPLE
    return {
        "name": name,
        "task": "tracker",
        "licence": "MIT",
        "commercial": True,
        "source": "https://github.com/hkchengrex/Cutie",
        "graph": graphs,
        "input": {
            "colour_order": "RGB",
            "scale": 1 / 255,
            "dynamic_verified": dynamic,
            "resize": {
                "rule": "none" if dynamic else "letterbox",
                "height": height,
                "width": width,
                "multiple_of": 16,
                "pad": "centre",
                "pad_value": [0.0, 0.0, 0.0],
            },
        },
        "tracker": {"style": "cutie", "frames": 5, "every": 5},
    }


# -------------------------------------------------------------------------- the cuts
def _modules(network: Any) -> dict[str, Any]:
    """A torch module for every graph."""
    return modules_of(
        network,
        {
            "encode_key": _encode_key,
            "encode_value": _encode_value,
            "memory_readout": _readout,
            "decode": _decode,
        },
    )


def _arguments(modules: dict[str, Any], size: tuple[int, int], objects: int, frames: int) -> dict[str, Any]:
    """Inputs of every graph for an image of (height, width): smooth, as pictures are; noise saturates the network."""
    import torch

    generator = torch.Generator().manual_seed(0)
    coarse = torch.rand(1, 3 + objects, size[0] // 16, size[1] // 16, generator=generator)
    fine = torch.nn.functional.interpolate(coarse, size, mode="bilinear")
    image, mask = fine[:, :3], fine[:, 3:] / objects
    with torch.no_grad():
        _, f8, f4, features, key, shrinkage, selection = modules["encode_key"](image)
        sensory = torch.zeros(1, objects, features.shape[1], *features.shape[2:])
        value, sensory, summary = modules["encode_value"](image, features, sensory, mask)
        held = [torch.stack([part] * frames, -3) for part in (key, shrinkage, value)]
        read = [key, selection, *held, summary[:, :, None], features, sensory, mask]
        readout = modules["memory_readout"](*read)
    return {
        "encode_key": [image],
        "encode_value": [image, features, sensory, mask],
        "memory_readout": read,
        "decode": [f8, f4, readout, sensory],
    }


def _encode_key(network: Any, image: Any) -> Any:
    """Features at strides 16, 8 and 4, and the key of every cell."""
    features, projected = network.encode_image(image)
    return (*features, projected, *network.transform_key(features[0]))


def _encode_value(network: Any, image: Any, features: Any, sensory: Any, mask: Any) -> Any:
    """What the masks (1, K, H, W) add to memory."""
    return network.encode_mask(image, features, sensory, mask)[:3]


def _readout(network: Any, key: Any, selection: Any, *tensors: Any) -> Any:
    """What memory says of the image: anisotropic distances, the nearest cells only (XMem, ECCV 2022, appendix)."""
    import torch

    keys, shrinkage, value, summary, features, sensory, mask = tensors
    objects, channels = value.shape[1:3]
    known = keys.flatten(2).transpose(1, 2)
    wanted, weight = key.flatten(2), selection.flatten(2)
    distance = (
        known.pow(2) @ weight
        - 2 * (known @ (wanted * weight))
        + (weight * wanted.pow(2)).sum(1, keepdim=True)
    )
    similarity = -distance * shrinkage.flatten(1)[:, :, None] / math.sqrt(keys.shape[1])
    nearest, places = torch.topk(similarity, TOP, 1)
    affinity = torch.zeros_like(similarity).scatter(1, places, torch.softmax(nearest, 1))
    visual = (value.flatten(1, 2).flatten(2) @ affinity).reshape(1, objects, channels, *key.shape[2:])
    return network.readout_query(network.pixel_fusion(features, visual, sensory, mask), summary)[0]


def _decode(network: Any, f8: Any, f4: Any, readout: Any, sensory: Any) -> Any:
    """Probabilities (1, 1 + K, H, W) and what is kept of the motion."""
    found, _, probability = network.segment([None, f8, f4], readout, sensory)
    return found, probability


# -------------------------------------------------------------------------- steps that can be traced
@contextmanager
def _traceable() -> Iterator[None]:
    """While it lasts, three steps of the authors' code are replaced by equal ones that keep no size."""
    transformer = importlib.import_module("cutie.model.transformer.object_transformer")
    places = importlib.import_module("cutie.model.transformer.positional_encoding")
    functional = importlib.import_module("torch.nn.functional")
    resize = functional.interpolate

    def interpolate(x: Any, *args: Any, **kwargs: Any) -> Any:
        return _pooled(x, **kwargs) if kwargs.get("mode") == "area" else resize(x, *args, **kwargs)

    with ExitStack() as stack:
        stack.enter_context(patch.object(functional, "interpolate", interpolate))
        stack.enter_context(patch.object(transformer.QueryTransformer, "_get_aux_mask", _blocked))
        stack.enter_context(patch.object(places.PositionalEncoding, "forward", _places))
        yield


def _pooled(x: Any, size: Any = None, scale_factor: Any = None, **_: Any) -> Any:
    """Means over squares; the sides are whole multiples here."""
    from torch.nn.functional import avg_pool2d

    step = round(1 / scale_factor) if scale_factor is not None else int(x.shape[-1]) // int(size[-1])
    return avg_pool2d(x, step)


def _blocked(transformer: Any, logits: Any, selector: Any) -> Any:
    """(K * heads, queries, cells) true where a query may not look: one half looks at the object, the other around it.

    A query that may look nowhere looks everywhere.
    """
    import torch

    aggregate = importlib.import_module("cutie.utils.tensor_utils").aggregate
    scores = aggregate(logits.sigmoid() if selector is None else logits.sigmoid() * selector, 1)
    inside = (scores[:, 1:] >= scores.max(1, keepdim=True)[0]).flatten(2)[:, :, None, None]
    half = (1, 1, transformer.num_heads, transformer.num_queries // 2, 1)
    blocked = torch.cat([(~inside).repeat(half), inside.repeat(half)], 3).flatten(0, 2)
    return blocked & ~blocked.all(-1, keepdim=True)


def _places(encoding: Any, tensor: Any) -> Any:
    """Sines and cosines of column and row, interleaved: (n, h, w, c), or (n, 1, h, w, c) for five dimensions."""
    import torch

    like = tensor[:, 0] if tensor.dim() == 5 else tensor
    rows, columns = like.shape[1:3] if encoding.channel_last else like.shape[2:4]
    waves = [_waves(encoding, side) for side in (columns, rows)]
    wide = waves[0][None].expand(rows, -1, -1), waves[1][:, None].expand(-1, columns, -1)
    both = torch.cat(wide, -1)
    if encoding.channel_last == encoding.transpose_output:
        both = both.permute(2, 0, 1)
    found = both[None].expand(like.shape[0], -1, -1, -1)
    return found[:, None] if tensor.dim() == 5 else found


def _waves(encoding: Any, side: Any) -> Any:
    """(side, channels / 2)"""
    import torch

    place = torch.arange(side).to(encoding.inv_freq)
    if encoding.normalize:
        place = place / (place[-1] + encoding.eps) * encoding.scale
    angle = place[:, None] * encoding.inv_freq[None]
    return torch.stack([angle.sin(), angle.cos()], -1).flatten(1)
