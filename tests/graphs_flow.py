"""A flow network without weights: block matching as an ONNX graph, with contracts as real networks have them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

STRETCH = 'rule = "stretch"\nmultiple_of = 16\nrounding = "up"\non = "float32"'
PAD = 'rule = "none"\nmultiple_of = 16\npad = "centre"\npad_mode = "replicate"'


def write_flow(
    folder: Path,
    resize: str = STRETCH,
    colour_order: str = "BGR",
    channels: tuple[float, float, float] = (1 / 3, 1 / 3, 1 / 3),
    radius: int = 4,
    stride: int = 1,
    both: bool = False,
    nan_on_black: bool = False,
    meaning: str = "flow in pixels of the resized image",
    flow: str = "flow",
) -> Path:
    """A folder with ``flow.onnx`` and its contract; returns the folder.

    The flow is the shift, at most ``radius`` px of the network's input, at which 9 x 9 px of the brightness (sum of
    ``channels``, 0 to 1) fit best, where several do the shortest; ``coarse`` is its mean over blocks of 8.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "flow.onnx"
    onnx.save_model(_graph(channels, radius, stride, both, nan_on_black), str(path))
    inputs = '{ both = "both" }' if both else '{ first = "0", second = "1" }'
    (folder / "contract.toml").write_text(
        f"""name = "block-matching"
task = "flow"
licence = "BSD-3-Clause"
commercial = true
[graph.main]
file = "flow.onnx"
sha256 = "{hashlib.sha256(path.read_bytes()).hexdigest()}"
inputs = {inputs}
outputs = {{ flow = "{flow}" }}
[input]
colour_order = "{colour_order}"
scale = {1 / 255}
dynamic_verified = true
[input.resize]
{resize}
[output]
tensor = "{flow}"
role = "flow"
meaning = "{meaning}"
"""
    )
    return folder


def _graph(
    channels: tuple[float, float, float], radius: int, stride: int, both: bool, nan: bool
) -> onnx.ModelProto:
    side = 2 * radius + 1
    dy, dx = (shift.ravel() for shift in np.mgrid[-radius : radius + 1, -radius : radius + 1])
    shifts = np.zeros((side**2, 1, side, side), np.float32)
    shifts[np.arange(side**2), 0, dy + radius, dx + radius] = 1
    constants = {
        "grey": np.array(channels, np.float32).reshape(1, 3, 1, 1),
        "shifts": shifts,
        "shorter": (1e-7 * (dx**2 + dy**2)).astype(np.float32).reshape(1, -1, 1, 1),
        "dx": dx.astype(np.float32),
        "dy": dy.astype(np.float32),
    }
    node = helper.make_node
    nodes = [node("Split", ["both"], ["0", "1"], axis=1)] if both else []
    nodes += [
        node("Conv", ["0", "grey"], ["one"]),
        node("Conv", ["1", "grey"], ["two"]),
        node("Conv", ["two", "shifts"], ["shifted"], pads=[radius] * 4),
        node("Sub", ["shifted", "one"], ["differences"]),
        node("Mul", ["differences", "differences"], ["squares"]),
        node("AveragePool", ["squares"], ["fit"], kernel_shape=[9, 9], pads=[4] * 4),
        node("Add", ["fit", "shorter"], ["cost"]),
        node("ArgMin", ["cost"], ["best"], axis=1, keepdims=1),
        node("Gather", ["dx", "best"], ["x"]),
        node("Gather", ["dy", "best"], ["y"]),
        node("Concat", ["x", "y"], ["field"], axis=1),
        node("AveragePool", ["field"], ["fine"], kernel_shape=[stride] * 2, strides=[stride] * 2),
        node("AveragePool", ["field"], ["coarse"], kernel_shape=[8, 8], strides=[8, 8]),
        *_last(nan),
    ]
    size = ["height", "width"]
    names = [("both", 6)] if both else [("0", 3), ("1", 3)]
    inputs = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, c, *size]) for n, c in names]
    outputs = [
        helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 2, f"h_{n}", f"w_{n}"])
        for n in ("coarse", "flow", "one")
    ]
    outputs[2] = helper.make_tensor_value_info("one", TensorProto.FLOAT, [1, 1, *size])
    held = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "block matching", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    return model


def _last(nan: bool) -> list[onnx.NodeProto]:
    """The flow, or the flow times 0/0 where the first image is black."""
    node = helper.make_node
    if not nan:
        return [node("Identity", ["fine"], ["flow"])]
    return [
        node("ReduceMax", ["one"], ["most"], keepdims=1),
        node("Div", ["most", "most"], ["certain"]),
        node("Mul", ["fine", "certain"], ["flow"]),
    ]
