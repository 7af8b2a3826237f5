"""Whether a graph is what its contract says: names, types, numbers of the shapes, and what ``[input]`` makes of a frame."""

from __future__ import annotations

from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME, Contract, Graph, Image

TYPES = {
    "tensor(float)": "float32",
    "tensor(float16)": "float16",
    "tensor(double)": "float64",
    "tensor(int64)": "int64",
    "tensor(int32)": "int32",
    "tensor(uint8)": "uint8",
    "tensor(bool)": "bool",
}
"""Words of ONNX Runtime for types."""


def check_graph(session: Any, graph: Graph, where: str, contract: Contract) -> None:
    """Refuse a graph whose tensors are not those of the contract.

    Parameters
    ----------
    session
        ONNX Runtime's.
    where
        Begins the errors.

    Raises
    ------
    ModelError
        Both sides are named.
    """
    ends = (("input", graph.inputs, session.get_inputs()), ("output", graph.outputs, session.get_outputs()))
    for what, named, tensors in ends:
        there = {tensor.name: tensor for tensor in tensors}
        for tensor in named.values():
            if tensor not in there:
                raise ModelError(
                    f"{where}: has no {what} {tensor}, which {NAME} names; the graph has {', '.join(there)}"
                )
            _check_tensor(there[tensor], graph, where)
    image = graph.inputs.get("image")
    if contract.input is not None and image:
        _check_image(next(t for t in session.get_inputs() if t.name == image), contract.input, where)


def _check_tensor(tensor: Any, graph: Graph, where: str) -> None:
    declared, kind = graph.shapes.get(tensor.name), graph.dtypes.get(tensor.name)
    found = TYPES.get(tensor.type, tensor.type)
    if kind is not None and kind != found:
        raise ModelError(f"{where}: {tensor.name} is {found}, {NAME} says {kind}")
    if declared is not None and _differ(declared, tensor.shape):
        raise ModelError(f"{where}: {tensor.name} is {list(tensor.shape)}, {NAME} says {declared}")


def _check_image(tensor: Any, image: Image, where: str) -> None:
    """What ``[input]`` makes of a frame against what the graph takes: type, rank, channels, sides that are fixed."""
    found = TYPES.get(tensor.type, tensor.type)
    if found != image.dtype:
        raise ModelError(f"{where}: input {tensor.name} is {found}, [input] dtype of {NAME} is {image.dtype}")
    rule = image.resize
    square = rule.long_side if rule.pad != "none" and rule.multiple_of == 1 else None
    high, wide = rule.height or square or "height", rule.width or square or "width"
    made: list[int | str] = ["batch", 3, high, wide] if image.layout == "NCHW" else [high, wide, 3]
    if _differ(made, tensor.shape):
        raise ModelError(
            f"{where}: input {tensor.name} is {list(tensor.shape)}, [input] of {NAME} makes {made} of a frame"
        )


def _differ(one: list[int | str], other: list[int | str]) -> bool:
    """Whether two shapes cannot be one: another rank, or two numbers that differ; names are free."""
    return len(one) != len(other) or any(
        isinstance(a, int) and isinstance(b, int) and a != b for a, b in zip(one, other, strict=True)
    )
