"""Trackers without weights: every cell takes the label of the cells in memory with its colour, and near it.

They have the tensors of DeAOT and of Cutie (as exported for one object and a fixed number of frames), so that the
adapters under test are those of the real networks.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from graphs import FLOAT, IMAGENET, RGB, Graph, _rgb, write_contract

SHARPNESS, NEARNESS = 60.0, 0.2
"""Of the softmax over squared distances, and what the whole width counts against a colour."""
ANY, CELLS = "side", "cells"


def write_tracker(folder: Path, objects: int = 10, gap: int = 3, frames: int = 2) -> Path:
    """DeAOT-shaped: ``objects`` identities; a cell each 4 px, sides of 16 k + 1 px."""
    names = ("encode", "identify", "reference", "propagate", "fuse")
    graphs = [_encode(), _identify(), _reference(), _propagate(objects), _fuse()]
    image = {"image": (FLOAT, [1, 3, ANY, ANY])}
    maps = {name: (FLOAT, [1, 5, "rows", "columns"]) for name in ("s4", "s8", "s16", "emb")}
    identity = {"identity": (FLOAT, [CELLS, 1, objects + 1])}
    memory = {"key": 5, "value": 5, "id": objects + 1}
    tokens = {name: (FLOAT, [1, CELLS, size]) for name, size in memory.items()}
    held = {f"{w}_{n}": (FLOAT, [1, w, s]) for w in ("long", "short") for n, s in memory.items()}
    context = {"context": (FLOAT, [1, CELLS, 5])}
    logits = {"logits": (FLOAT, [1, objects + 1, "rows", "columns"])}
    inputs = [image, {"one_hot": (FLOAT, [1, objects + 1, ANY, ANY])}, {"emb": maps["emb"], **identity},
              {**maps, **held}, {**context, **identity}]  # fmt: skip
    outputs = [maps, identity, tokens, {**logits, "key": tokens["key"], "value": tokens["value"], **context},
               {"id": tokens["id"]}]  # fmt: skip
    files = {
        name: graph.write(folder / f"{name}.onnx", taken, left)
        for name, graph, taken, left in zip(names, graphs, inputs, outputs, strict=True)
    }
    content = {
        "name": "propagation",
        "task": "tracker",
        "graph": files,
        "input": {
            **IMAGENET,
            "resize": {"rule": "stretch", "multiple_of": 16, "plus": 1, "interpolation": "cubic"},
            "dynamic_verified": True,
        },
        "tracker": {"style": "deaot", "objects": objects, "gap": gap, "frames": frames},
    }
    return write_contract(folder, content)


def _pooled(graph: Graph, tensor: str, name: str = "") -> str:
    """A mean each 4 px, around the pixels that stay when corners lie on corners."""
    window = {"kernel_shape": [5, 5], "strides": [4, 4], "pads": [2, 2, 2, 2]}
    return graph("AveragePool", tensor, name=name, **window)


def _with_place(graph: Graph, colour: str, name: str) -> str:
    """(1, 3, h, w) and the place of every cell: (1, 5, h, w)."""
    parts = [colour]
    for axis, shape in ((3, (1, 1, 1, -1)), (2, (1, 1, -1, 1))):
        share = graph("Div", graph.steps(colour, axis), graph.size(colour, axis))
        place = graph("Reshape", graph("Mul", share, np.float32(NEARNESS)), np.int64(shape))
        one = graph("Slice", colour, np.int64([0]), np.int64([1]), np.int64([1]))
        parts.append(graph("Add", graph("Mul", one, np.float32(0)), place))
    return graph("Concat", *parts, axis=1, name=name)


def _encode() -> Graph:
    graph = Graph()
    _with_place(graph, _pooled(graph, _rgb(graph, "image")), "emb")
    for name in ("s4", "s8", "s16"):
        graph("Identity", "emb", name=name)
    return graph


def _tokens(graph: Graph, plane: str, name: str = "") -> str:
    """(1, c, h, w) -> (1, h * w, c)."""
    return graph("Transpose", graph("Reshape", plane, np.int64([0, 0, -1])), perm=[0, 2, 1], name=name)


def _identify() -> Graph:
    graph = Graph()
    graph("Transpose", _tokens(graph, _pooled(graph, "one_hot")), perm=[1, 0, 2], name="identity")
    return graph


def _reference() -> Graph:
    graph = Graph()
    _tokens(graph, "emb", "key")
    graph("Identity", "key", name="value")
    graph("Transpose", "identity", perm=[1, 0, 2], name="id")
    return graph


def _propagate(objects: int) -> Graph:
    graph = Graph()
    _tokens(graph, "emb", "key")
    for name in ("value", "context"):
        graph("Identity", "key", name=name)
    memory, ids = (graph("Concat", f"long_{n}", f"short_{n}", axis=1) for n in ("key", "id"))
    found = graph("MatMul", _affinity(graph, "key", memory), ids)
    shape = graph(
        "Concat",
        np.int64([1, objects + 1]),
        graph("Slice", graph("Shape", "emb"), np.int64([2]), np.int64([4])),
        axis=0,
    )
    logits = graph("Log", graph("Max", found, np.float32(1e-6)))
    graph("Reshape", graph("Transpose", logits, perm=[0, 2, 1]), shape, name="logits")
    return graph


def _affinity(graph: Graph, query: str, memory: str, never: str = "") -> str:
    """(1, Q, M) soft nearest neighbours of (1, Q, c) among (1, M, c); ``never`` (1, 1, M) is added to the distance."""
    lengths = [graph("ReduceSum", graph("Mul", x, x), np.int64([2]), keepdims=1) for x in (query, memory)]
    product = graph("MatMul", query, graph("Transpose", memory, perm=[0, 2, 1]))
    apart = graph("Add", lengths[0], graph("Transpose", lengths[1], perm=[0, 2, 1]))
    distance = graph("Sub", apart, graph("Mul", product, np.float32(2)))
    distance = graph("Add", distance, never) if never else distance
    return graph("Softmax", graph("Mul", distance, np.float32(-SHARPNESS)), axis=2)


def _fuse() -> Graph:
    graph = Graph()
    graph("Transpose", "identity", perm=[1, 0, 2], name="id")
    return graph


# -------------------------------------------------------------------------- Cutie
def write_cutie_tracker(folder: Path, frames: int = 3, every: int = 2) -> Path:
    """Cutie-shaped, as OpenShot exports it: one object a call, ``frames`` places in memory; a cell each 4 px."""
    plane = ["rows", "columns"]
    key, one = (FLOAT, [1, 5, *plane]), (FLOAT, [1, 1, *plane])
    sensory, mask = {"sensory": (FLOAT, [1, 1, 1, *plane])}, (FLOAT, [1, 1, ANY, ANY])
    held = {
        "memory_key": (FLOAT, [1, 5, frames, *plane]),
        "memory_shrinkage": (FLOAT, [1, 1, frames, *plane]),
        "memory_value": (FLOAT, [1, 1, 1, frames, *plane]),
        "memory_valid": (FLOAT, [1, 1, frames, *plane]),
    }
    image, readout = {"image": (FLOAT, [1, 3, ANY, ANY])}, {"memory_readout": (FLOAT, [1, 1, 1, *plane])}
    summary = {"object_memory": (FLOAT, [1, 1, 1, 2])}
    query = {"query_key": key, "query_selection": key, "pix_feat": key, **sensory, "last_mask": mask}
    files = {
        "encode_key": _encode_key().write(
            folder / "encode-key.onnx",
            image,
            {**dict.fromkeys(("f16", "f8", "f4", "pix_feat", "key", "selection"), key), "shrinkage": one},
        ),
        "encode_value": _encode_value().write(
            folder / "encode-value.onnx",
            {**image, "pix_feat": key, **sensory, "mask": mask},
            {"mask_value": readout["memory_readout"], "new_sensory": sensory["sensory"], **summary},
        ),
        "memory_readout": _memory_readout().write(
            folder / "memory-readout.onnx",
            {**query, **held, "object_memory": (FLOAT, [1, 1, 1, 1, 2])},
            readout,
        ),
        "decode": _decode().write(
            folder / "decode.onnx",
            {"f8": key, "f4": key, **readout, **sensory},
            {"new_sensory": sensory["sensory"], "prob": (FLOAT, [1, 2, ANY, ANY])},
        ),
    }
    resize = {"rule": "none", "multiple_of": 16, "pad": "centre", "pad_value": [0, 0, 0]}
    content = {
        "name": "cutie-propagation",
        "task": "tracker",
        "graph": files,
        "input": {**RGB, "resize": resize, "dynamic_verified": True},
        "tracker": {"style": "cutie", "frames": frames, "every": every},
    }
    return write_contract(folder, content)


def _encode_key() -> Graph:
    graph = Graph()
    colour = graph("AveragePool", "image", kernel_shape=[4, 4], strides=[4, 4])
    _with_place(graph, colour, "key")
    for name in ("f16", "f8", "f4", "pix_feat", "selection"):
        graph("Identity", "key", name=name)
    graph("ReduceSum", "key", np.int64([1]), keepdims=1, name="shrinkage")
    return graph


def _encode_value() -> Graph:
    graph = Graph()
    cells = graph("AveragePool", "mask", kernel_shape=[4, 4], strides=[4, 4])
    graph("Unsqueeze", cells, np.int64([1]), name="mask_value")
    graph("Identity", "mask_value", name="new_sensory")
    area = graph("Reshape", graph("ReduceSum", cells, keepdims=1), np.int64([1, 1, 1, 1]))
    graph("Concat", area, area, axis=3, name="object_memory")
    return graph


def _memory_readout() -> Graph:
    graph = Graph()
    query = _tokens(graph, "query_key")
    memory = _tokens(graph, "memory_key")
    valid = graph("Reshape", "memory_valid", np.int64([1, 1, -1]))
    never = graph("Mul", graph("Sub", np.float32(1), valid), np.float32(100))
    found = graph(
        "MatMul",
        _affinity(graph, query, memory, never),
        graph("Reshape", "memory_value", np.int64([1, -1, 1])),
    )
    shape = graph(
        "Concat",
        np.int64([1, 1, 1]),
        graph("Slice", graph("Shape", "query_key"), np.int64([2]), np.int64([4])),
        axis=0,
    )
    graph("Reshape", found, shape, name="memory_readout")
    return graph


def _decode() -> Graph:
    graph = Graph()
    graph("Identity", "memory_readout", name="new_sensory")
    cells = graph("Squeeze", "memory_readout", np.int64([1]))
    large = graph("Resize", cells, "", np.float32([1, 1, 4, 4]), mode="linear")
    object_ = graph("Clip", large, np.float32(0), np.float32(1))
    graph("Concat", graph("Sub", np.float32(1), object_), object_, axis=1, name="prob")
    return graph
