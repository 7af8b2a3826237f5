"""DeAOT from the user's own weights and the authors' own code, as five graphs and their contract.

The network is built by the package that the user has installed (``deaotpy``, or a checkout of ``aot-benchmark`` on
``PYTHONPATH``); here are only the cuts between graphs, and one layer in a form that can be traced: attention within a
window, as attention over all cells with the others masked.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    export_graph,
    fill,
    load_weights,
    modules_of,
    verified_dynamic,
    write_contract,
)

PACKAGES = ("aot.", "")
"""Where the authors' modules are: in deaotpy, in a checkout of aot-benchmark."""
LONGEST = 1040
"""px, of the long side: 1.3 times 800, as the authors test."""
EXAMPLE, SECOND = (129, 97), (97, 161)
"""Sizes (16 k + 1) of the export and of its comparison."""
OBJECTS = 10
SHORTCUTS = ("s4", "s8", "s16")
MEMORY = ("key", "value", "id")
LONG, SHORT = (tuple(f"{which}_{name}" for name in MEMORY) for which in ("long", "short"))


def export_deaot(checkpoint: Path, folder: Path, name: str = "r50-deaotl") -> Path:
    """Graphs and contract of a DeAOT; returns the contract's path.

    Parameters
    ----------
    name
        The authors' name of the network, with hyphens: ``deaott`` to ``deaotl``, ``r50-deaotl``, ``swinb-deaotl``.

    Raises
    ------
    ModelError
        The authors' code is not installed, the file is no weights of this network, or a graph gives other values than
        torch.
    """
    network, gap = deaot(name)
    fill(network, load_weights(checkpoint), checkpoint)
    return write_deaot(network, folder, name, gap)


def deaot(name: str) -> tuple[Any, int]:
    """The authors' network, with random weights, and the gap of its long-term memory in their tests.

    Raises
    ------
    ModelError
        Their code is not installed or has no such network.
    """
    why = ""
    for package in PACKAGES:
        try:
            configs = importlib.import_module(f"{package}configs.models.{name.replace('-', '_')}")
            models = importlib.import_module(f"{package}networks.models")
        except ImportError as error:
            why = why or str(error)
            continue
        config = configs.ModelConfig()
        for key, value in _training().items():
            setattr(config, key, value)
        return models.build_vos_model(config.MODEL_VOS, config).eval(), int(config.TEST_LONG_TERM_MEM_GAP)
    raise ModelError(
        f"{name}: the code of DeAOT's authors is not there or does not know it ({why}); pip install deaotpy, or put a "
        "checkout of github.com/yoxu515/aot-benchmark on PYTHONPATH"
    )


def _training() -> dict[str, Any]:
    """What the constructor asks for and a trained network does not use."""
    off = ("EMB_DROPOUT", "ID_DROPOUT", "DROPPATH", "LT_DROPOUT", "ST_DROPOUT")
    return {
        **{f"TRAIN_LSTT_{what}": 0.0 for what in off},
        "TRAIN_LSTT_DROPPATH_SCALING": False,
        "TRAIN_LSTT_DROPPATH_LST": False,
        "TRAIN_ENCODER_FREEZE_AT": 0,
    }


def write_deaot(network: Any, folder: Path, name: str, gap: int = 5) -> Path:
    """Graphs and contract of a DeAOT that is built and has its weights; returns the contract's path."""
    with _traceable(network):
        modules = _modules(network)
        dynamic, graphs = [], {}
        first, second = (_arguments(modules, size) for size in (EXAMPLE, SECOND))
        for graph, module in modules.items():
            path = folder / f"{name}-{graph}.onnx"
            inputs, outputs = NAMES[graph]
            if graph == "fuse" and len(network.LSTT.layers) == 1:
                inputs = ("identity",)  # the first layer's memory holds no context
            axes = {tensor: AXES[tensor] for tensor in (*inputs, *outputs)}
            export_graph(module, first[graph], path, inputs, outputs, axes)
            dynamic.append(verified_dynamic(module, path, [second[graph]]))
            graphs[graph] = {"file": path.name}
    return write_contract(folder, _contract(name, graphs, all(dynamic), gap))


NAMES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "encode": (("image",), (*SHORTCUTS, "emb")),
    "identify": (("one_hot",), ("identity",)),
    "reference": (("emb", "identity"), MEMORY),
    "propagate": ((*SHORTCUTS, "emb", *LONG, *SHORT), ("logits", "key", "value", "context")),
    "fuse": (("context", "identity"), ("id",)),
}
"""Inputs and outputs of every graph."""
AXES: dict[str, dict[int, str]] = {
    "image": {2: "height", 3: "width"},
    "one_hot": {2: "height", 3: "width"},
    "identity": {0: "cells"},
    "emb": {2: "rows", 3: "columns"},
    **{name: {2: f"{name}_rows", 3: f"{name}_columns"} for name in (*SHORTCUTS, "logits")},
    **{name: {1: "cells"} for name in (*MEMORY, *SHORT, "context")},
    **{name: {1: "remembered"} for name in LONG},
}
"""What is free."""


def _contract(name: str, graphs: dict[str, Any], dynamic: bool, gap: int) -> dict[str, Any]:
    height, width = (None, None) if dynamic else EXAMPLE
    return {
        "name": name,
        "task": "tracker",
        "licence": "BSD-3-Clause",
        "commercial": True,
        "source": "https://github.com/yoxu515/aot-benchmark",
        "graph": graphs,
        "input": {
            "colour_order": "RGB",
            "scale": 1 / 255,
            "mean": [0.485, 0.456, 0.406],
            "std": [0.229, 0.224, 0.225],
            "dynamic_verified": dynamic,
            "resize": {
                "rule": "long-side" if dynamic else "stretch",
                "long_side": LONGEST if dynamic else None,
                "enlarge": False,
                "height": height,
                "width": width,
                "multiple_of": 16,
                "plus": 1,
                "interpolation": "cubic",
                "on": "float32",
            },
        },
        "tracker": {"style": "deaot", "objects": OBJECTS, "gap": min(gap, 10_000), "frames": 8},
    }


# -------------------------------------------------------------------------- the cuts
def _modules(network: Any) -> dict[str, Any]:
    """A torch module for every graph."""
    return modules_of(
        network,
        {
            "encode": _encode,
            "identify": _identify,
            "reference": _reference,
            "propagate": _propagate,
            "fuse": _fuse,
        },
    )


def _arguments(modules: dict[str, Any], size: tuple[int, int]) -> dict[str, Any]:
    """Inputs of every graph for an image of (height, width), with two frames in the long memory."""
    import torch

    generator = torch.Generator().manual_seed(0)
    image = torch.randn(1, 3, *size, generator=generator)
    number = torch.randint(0, OBJECTS + 1, (1, *size), generator=generator)
    one_hot = torch.nn.functional.one_hot(number, OBJECTS + 1).permute(0, 3, 1, 2).float()
    with torch.no_grad():
        encoded = modules["encode"](image)
        identity = modules["identify"](one_hot)
        memory = modules["reference"](encoded[-1], identity)
        long = [torch.cat([part, part], 1) for part in memory]
        context = modules["propagate"](*encoded, *long, *memory)[3]
    return {
        "encode": [image],
        "identify": [one_hot],
        "reference": [encoded[-1], identity],
        "propagate": [*encoded, *long, *memory],
        "fuse": [context, identity] if len(context) > 1 else [identity],
    }


def _encode(network: Any, image: Any) -> Any:
    """(1, 3, H, W) -> shortcuts at strides 4, 8 and 16, and what is matched, at 16."""
    return tuple(network.encode_image(image))


def _identify(network: Any, one_hot: Any) -> Any:
    """(1, 11, H, W) -> (cells, 1, channels)."""
    return network.get_id_emb(one_hot).flatten(2).permute(2, 0, 1)


def _reference(network: Any, emb: Any, identity: Any) -> Any:
    """Memory of a frame whose masks are given: (layers, cells, channels) each."""
    import torch

    size = emb.shape[2:]
    _, _, memories, _ = network.LSTT_forward([emb], None, None, identity, None, size)
    return tuple(torch.cat([layer[part] for layer in memories], 1).transpose(0, 1) for part in (0, 1, 3))


def _propagate(network: Any, *tensors: Any) -> Any:
    """Logits of a frame from memory, and what is to be remembered of it."""
    import torch

    s4, s8, s16, emb = tensors[:4]
    layers = len(network.LSTT.layers)
    long = [[_token(part, i) for part in tensors[4:7]] for i in range(layers)]
    short = [[_plane(_token(part, i), emb) for part in tensors[7:10]] for i in range(layers)]
    found, current, _, _ = network.LSTT_forward(
        [emb],
        [[k, v, None, i] for k, v, i in long],
        [[k, v, None, i] for k, v, i in short],
        None,
        None,
        emb.shape[2:],
    )
    logits = network.decode_id_logits(found, [s4, s8, s16, emb])
    key, value = (torch.cat([layer[part] for layer in current], 1).transpose(0, 1) for part in (0, 1))
    nothing = torch.zeros_like(emb.flatten(2).permute(2, 0, 1))
    before = torch.cat([nothing if layer[3] is None else layer[3] for layer in current], 1)
    return logits, key, value, before.transpose(0, 1)


def _fuse(network: Any, *tensors: Any) -> Any:
    """What the masks of a frame add to its memory, from its context and them: (layers, cells, channels)."""
    import torch

    context, identity = tensors[0], tensors[-1]
    found = [
        layer.fuse_key_value_id(None, _token(context, i) if i else None, identity)[1]
        for i, layer in enumerate(network.LSTT.layers)
    ]
    return torch.cat(found, 1).transpose(0, 1)


def _token(memory: Any, layer: int) -> Any:
    """(cells, 1, channels) of one layer."""
    return memory[layer : layer + 1].transpose(0, 1)


def _plane(tokens: Any, like: Any) -> Any:
    """(1, channels, rows, columns)."""
    return tokens.permute(1, 2, 0).reshape(1, -1, *like.shape[2:])


# -------------------------------------------------------------------------- a window as a mask
@contextmanager
def _traceable(network: Any) -> Iterator[None]:
    """While it lasts, attention within windows is computed over all cells: traced, the authors' form keeps its size."""
    layers = [layer.short_term_attn for layer in network.LSTT.layers]
    for layer in layers:
        layer.forward = lambda q, k, v, u, size, _layer=layer: _windowed(_layer, q, k, v, u)
    try:
        yield
    finally:
        for layer in layers:
            del layer.forward


def _windowed(layer: Any, q: Any, k: Any, v: Any, u: Any) -> tuple[Any, None]:
    """Gated propagation from the cells at most ``max_dis`` away, with a bias that each cell has for each offset.

    Parameters
    ----------
    q, k, v
        (1, channels, rows, columns); one head.
    u
        (cells, 1, channels) the gate.
    """
    import torch

    rows, columns = q.shape[2:]
    bias = layer.relative_emb_k(q).flatten(2)[0].transpose(0, 1)
    query, key, value = (x.flatten(2)[0].transpose(0, 1) for x in (q, k, v))
    y, x = _grid(rows, columns)
    dy, dx = y[None] - y[:, None], x[None] - x[:, None]
    reach, side = layer.max_dis, layer.window_size
    offset = (dy.clamp(-reach, reach) + reach) * side + dx.clamp(-reach, reach) + reach
    score = (query / layer.T) @ key.transpose(0, 1) + bias.gather(1, offset)
    outside = (dy.abs() > reach) | (dx.abs() > reach)
    found = torch.softmax(score.masked_fill(outside, -1e8), 1) @ value
    return layer.projection(layer.dw_conv(found[:, None] * u, (rows, columns))), None


def _grid(rows: Any, columns: Any) -> tuple[Any, Any]:
    """Row and column of every cell."""
    import torch

    y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    return y.flatten(), x.flatten()
