"""Small networks with real behaviour and no weights, written as ONNX graphs with their contracts.

They keep the tensors and conventions of the networks they stand for (RAM, Grounding DINO, SAM, YOLO, a depth
network), and know one thing: plain red, green, blue and yellow. ``coloured_clip`` draws what they see.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from conftest import textured
from onnx import TensorProto, helper, numpy_helper

FLOAT, INT, BOOL = TensorProto.FLOAT, TensorProto.INT64, TensorProto.BOOL
COLOURS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1), "yellow": (1, 1, 0)}
"""RGB, 0 to 1."""
KEYS = np.array(list(COLOURS.values()), np.float32).reshape(-1, 3, 1, 1)
TAGS = ("red square", "green square", "blue square", "yellow square", "sky", "stand")
"""The last two are on in every picture; nothing is ever there to be boxed, and "stand" has a threshold of 1."""
THRESHOLDS = (0.68, 0.68, 0.68, 0.68, 0.68, 1.0)
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
RGB = {"colour_order": "RGB", "scale": 1 / 255}
IMAGENET = {**RGB, "mean": list(MEAN), "std": list(STD)}
VOCABULARY = (
    *(
        "[PAD]",
        "[UNK]",
        "[CLS]",
        "[SEP]",
        "[MASK]",
        ".",
        "?",
        "-",
        "red",
        "green",
        "blue",
        "yellow",
        "square",
    ),
    *("dog", "cat", "person", "sky", "teddy", "bear", "stand", "##s", "##square"),
    *"abcdefghijklmnopqrstuvwxyz",
    *(f"##{letter}" for letter in "abcdefghijklmnopqrstuvwxyz"),
)
TOKENS = 256


class Graph:
    """Nodes in the order of writing; each gives the name of what it makes."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.numbers = count()

    def __call__(self, kind: str, *inputs: Any, name: str = "", **attributes: Any) -> str:
        name = name or f"{kind.lower()}_{next(self.numbers)}"
        given = [value if isinstance(value, str) else self.constant(value) for value in inputs]
        self.nodes.append(helper.make_node(kind, given, [name], **attributes))
        return name

    def constant(self, value: Any) -> str:
        array = np.asarray(value)
        array = array.astype(np.float32 if array.dtype.kind == "f" else array.dtype)
        name = f"constant_{next(self.numbers)}"
        self.constants.append(numpy_helper.from_array(array.copy(order="C"), name))
        return name

    def size(self, tensor: str, axis: int) -> str:
        """A side of a tensor as a float."""
        return self("Cast", self("Gather", self("Shape", tensor), np.int64(axis)), to=FLOAT)

    def steps(self, tensor: str, axis: int) -> str:
        """0, 1, 2, ... along an axis."""
        size = self("Gather", self("Shape", tensor), np.int64(axis))
        return self("Cast", self("Range", np.int64(0), size, np.int64(1)), to=FLOAT)

    def write(self, path: Path, inputs: Mapping[str, Any], outputs: Mapping[str, Any]) -> dict[str, Any]:
        """Save, and give what a contract says of the file. Tensors are (type, shape)."""
        described = [
            [helper.make_tensor_value_info(name, *value) for name, value in side.items()]
            for side in (inputs, outputs)
        ]
        graph = helper.make_graph(self.nodes, path.stem, *described, self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model, full_check=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(model.SerializeToString())
        return described_file(path)


def described_file(path: Path) -> dict[str, Any]:
    """Name, digest and size, as a contract has them."""
    content = path.read_bytes()
    return {"file": path.name, "sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}


def write_lines(path: Path, lines: Sequence[object]) -> dict[str, Any]:
    """A text file, without a newline at its end as in RAM's own, and what a contract says of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(map(str, lines)), encoding="utf-8")
    return described_file(path)


def write_contract(folder: Path, content: Mapping[str, Any]) -> Path:
    """``contract.toml``; every value is written as an inline table, a list, a number or a string."""
    said = {"licence": "none needed", "commercial": True, "source": "tests/graphs.py", **content}
    lines = [f"{name} = {_toml(value)}" for name, value in said.items()]
    (folder / "contract.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_toml(part)}" for name, part in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def _rgb(graph: Graph, tensor: str) -> str:
    """The normalisation of ImageNet undone: 0 to 1."""
    mean, std = (np.float32(values).reshape(1, 3, 1, 1) for values in (MEAN, STD))
    return graph("Add", graph("Mul", tensor, std), mean)


def _hits(graph: Graph, rgb: str) -> str:
    """(colours, h, w) 1 where a pixel has a colour, else 0."""
    away = graph("ReduceMax", graph("Abs", graph("Sub", rgb, KEYS)), axes=[1], keepdims=0)
    return graph("Cast", graph("Less", away, np.float32(0.2)), to=FLOAT)


def _extent(graph: Graph, hits: str, axis: int) -> tuple[str, str]:
    """(colours, 1) first and last + 1 place of the hits along an axis, 1 for rows and 2 for columns."""
    line = graph("ReduceMax", hits, axes=[3 - axis], keepdims=0)
    place, size = graph.steps(line, 1), graph.size(line, 1)
    last = graph("ReduceMax", graph("Mul", line, graph("Add", place, np.float32(1))), axes=[1], keepdims=1)
    from_end = graph("ReduceMax", graph("Mul", line, graph("Sub", size, place)), axes=[1], keepdims=1)
    return graph("Sub", size, from_end), last


def _middle_and_size(graph: Graph, extent: tuple[str, str], unit: str | None) -> tuple[str, str]:
    first, last = extent
    middle, size = graph("Mul", graph("Add", first, last), np.float32(0.5)), graph("Sub", last, first)
    return (middle, size) if unit is None else (graph("Div", middle, unit), graph("Div", size, unit))


def _found(graph: Graph, hits: str) -> str:
    """(colours, 1) whether a colour is there."""
    return graph("Greater", graph("ReduceSum", hits, np.int64([1, 2]), keepdims=0), np.float32(8))


def write_tagger(folder: Path, meaning: str = "logits") -> Path:
    """RAM-shaped: ``image`` to the scores of ``TAGS``; a colour is on from about 1 % of the pixels."""
    graph = Graph()
    part = graph("ReduceMean", _hits(graph, _rgb(graph, "image")), axes=[1, 2], keepdims=0)
    colours = graph("Sub", graph("Mul", part, np.float32(600)), np.float32(6))
    logits = graph("Unsqueeze", graph("Concat", colours, np.float32([1.0, 3.0]), axis=0), np.int64([0]))
    graph("Identity" if meaning == "logits" else "Sigmoid", logits, name="logits")
    file = graph.write(
        folder / "tagger.onnx",
        {"image": (FLOAT, [1, 3, 96, 96])},
        {"logits": (FLOAT, [1, len(TAGS)])},
    )
    resize = {"rule": "stretch", "height": 96, "width": 96, "interpolation": "antialias"}
    content = {
        "name": "tagger",
        "task": "tags",
        **file,
        "input": {"tensor": "image", **IMAGENET, "resize": resize},
        "output": {"tensor": "logits"},
        "tags": {
            "names": write_lines(folder / "tags.txt", TAGS),
            "thresholds": write_lines(folder / "thresholds.txt", THRESHOLDS),
            "meaning": meaning,
        },
    }
    return write_contract(folder, content)


def write_detector(
    folder: Path,
    original: bool = False,
    resize: Mapping[str, Any] | None = None,
    phrases: str = "several",
    most_tokens: int = TOKENS,
    colour_order: str = "RGB",
) -> Path:
    """Grounding-DINO-shaped: a box for each colour, scored at the tokens of the colour's name.

    Parameters
    ----------
    original : tensors of the authors' code, whose boxes count from the canvas; else those of Hugging Face, with a
        mask of pixels, whose boxes count from the picture.
    """
    graph = Graph()
    hits = _hits(graph, _rgb(graph, "img" if original else "pixel_values"))
    if original:
        sides = graph.size(hits, 1), graph.size(hits, 2)
    else:
        pixels = graph("Cast", "pixel_mask", to=FLOAT)
        hits = graph("Mul", hits, pixels)
        sides = tuple(
            graph("ReduceMax", graph("ReduceSum", pixels, np.int64([axis])), keepdims=0) for axis in (1, 2)
        )
    rows, columns = (_middle_and_size(graph, _extent(graph, hits, axis), sides[axis - 1]) for axis in (1, 2))
    boxes = graph("Concat", columns[0], rows[0], columns[1], rows[1], axis=1)
    graph("Unsqueeze", boxes, np.int64([0]), name="boxes" if original else "pred_boxes")
    keys = np.array([[VOCABULARY.index(name)] for name in COLOURS])
    here = graph(
        "And", graph("Unsqueeze", _found(graph, hits), np.int64([1])), graph("Equal", "input_ids", keys)
    )
    if original:  # a token that attends to itself only is no word of a phrase
        company = graph("ReduceSum", graph("Cast", "text_token_mask", to=FLOAT), np.int64([2]), keepdims=0)
        here = graph("And", here, graph("Greater", company, np.float32(1.5)))
    logits = graph("Unsqueeze", graph("Where", here, np.float32(4), np.float32(-6)), np.int64([0]))
    length = graph("Gather", graph("Shape", "input_ids"), np.int64([1]))
    pads = graph("Concat", np.zeros(5, np.int64), graph("Sub", np.int64([TOKENS]), length), axis=0)
    graph("Pad", logits, pads, np.float32(-np.inf), name="logits")
    file = graph.write(
        folder / "detector.onnx",
        _original_inputs() if original else _hugging_face_inputs(),
        {"logits": (FLOAT, [1, 4, TOKENS]), ("boxes" if original else "pred_boxes"): (FLOAT, [1, 4, 4])},
    )
    file["inputs"] = {"image": "img" if original else "pixel_values"}
    file["outputs"] = {"boxes": "boxes" if original else "pred_boxes"}
    resize = resize or {"rule": "none", "pad": "bottom-right", "multiple_of": 32}
    vocabulary = write_lines(folder / "vocab.txt", VOCABULARY)
    content = {
        "name": "detector",
        "task": "text-boxes",
        "graph": {"main": file},
        "input": {**IMAGENET, "colour_order": colour_order, "resize": resize},
        "text": {"vocabulary": vocabulary, "phrases": phrases, "most_tokens": most_tokens},
    }
    return write_contract(folder, content)


def _hugging_face_inputs() -> dict[str, Any]:
    words = dict.fromkeys(("input_ids", "token_type_ids", "attention_mask"), (INT, [1, "tokens"]))
    return {
        "pixel_values": (FLOAT, [1, 3, "height", "width"]),
        **words,
        "pixel_mask": (INT, [1, "height", "width"]),
    }


def _original_inputs() -> dict[str, Any]:
    return {
        "img": (FLOAT, [1, 3, "height", "width"]),
        "input_ids": (INT, [1, "tokens"]),
        "attention_mask": (BOOL, [1, "tokens"]),
        "position_ids": (INT, [1, "tokens"]),
        "token_type_ids": (INT, [1, "tokens"]),
        "text_token_mask": (BOOL, [1, "tokens", "tokens"]),
    }


SEGMENTER = {"rule": "long-side", "long_side": 256, "pad": "bottom-right", "interpolation": "antialias"}


def write_segmenter(folder: Path, passes: int = 1, resize: Mapping[str, Any] = SEGMENTER) -> Path:
    """SAM-shaped, in two graphs: of a box, what has the colour of its middle; of a point, what has its colour.

    Of four masks the first is the whole box and is not to be chosen, the second the object, the third the box, the
    fourth the left of the object. Where the colour is pale, the object's predicted IoU is low.
    """
    encoder = Graph()
    window = {"kernel_shape": [2, 2], "strides": [2, 2]}
    encoder("AveragePool", "pixels", name="image_embeddings", **window)
    side: Any = resize.get("long_side", "side")
    embedding = {"image_embeddings": (FLOAT, [1, 3, "rows", "columns"])}
    files = {
        "encoder": encoder.write(folder / "encoder.onnx", {"pixels": (FLOAT, [1, 3, side, side])}, embedding),
        "decoder": _mask_decoder().write(
            folder / "decoder.onnx",
            {
                **embedding,
                "point_coords": (FLOAT, [1, "points", 2]),
                "point_labels": (FLOAT, [1, "points"]),
                "mask_input": (FLOAT, [1, 1, 128, 128]),
                "has_mask_input": (FLOAT, [1]),
            },
            {
                "iou_predictions": (FLOAT, [1, 4]),
                "low_res_masks": (FLOAT, [1, 4, "rows", "columns"]),
            },
        ),
    }
    files["encoder"]["inputs"] = {"image": "pixels"}
    files["decoder"]["inputs"] = {"points": "point_coords", "labels": "point_labels"}
    files["decoder"]["outputs"] = {"logits": "low_res_masks", "quality": "iou_predictions"}
    content = {
        "name": "segmenter",
        "task": "box-masks",
        "graph": files,
        "input": {**IMAGENET, "resize": resize},
        "masks": {"style": "sam", "passes": passes},
    }
    return write_contract(folder, content)


def _mask_decoder() -> Graph:
    graph = Graph()
    rgb = _rgb(graph, "image_embeddings")
    real = graph(
        "Compress",
        "point_coords",
        graph("Greater", graph("Squeeze", "point_labels", np.int64([0])), np.float32(0)),
        axis=1,
    )
    corners = graph("Mul", graph("Squeeze", real, np.int64([0])), np.float32(0.5))
    low = graph("ReduceMin", corners, axes=[0], keepdims=0)
    high = graph("ReduceMax", corners, axes=[0], keepdims=0)
    x = graph("Add", graph.steps(rgb, 3), np.float32(0.5))
    y = graph("Unsqueeze", graph("Add", graph.steps(rgb, 2), np.float32(0.5)), np.int64([1]))
    box = _between(graph, x, low, high, 0, y)
    label = graph("ReduceMax", "point_labels", axes=[0, 1], keepdims=0)
    inside = graph("Or", box, graph("Less", label, np.float32(1.5)))
    middle = graph("Mul", graph("Add", low, high), np.float32(0.5))
    last = graph("Sub", graph("Slice", graph("Shape", rgb), np.int64([2]), np.int64([4])), np.int64(1))
    place = graph("Cast", graph("Floor", graph("Gather", middle, np.int64([1, 0]))), to=INT)
    pixels = graph("Transpose", graph("Squeeze", rgb, np.int64([0])), perm=[1, 2, 0])
    colour = graph("GatherND", pixels, graph("Max", graph("Min", place, last), np.int64(0)))
    away = graph("Abs", graph("Sub", pixels, colour))
    same = graph("Less", graph("ReduceMax", away, axes=[2], keepdims=0), np.float32(0.25))
    mask = graph("And", same, inside)
    half = graph("And", mask, graph("Less", x, graph("Gather", middle, np.int64(0))))
    stack = [graph("Unsqueeze", part, np.int64([0])) for part in (box, mask, box, half)]
    logits = graph("Where", graph("Concat", *stack, axis=0), np.float32(8), np.float32(-8))
    logits = graph("Unsqueeze", logits, np.int64([0]))
    given = graph("ReduceMax", "has_mask_input", keepdims=0)
    graph(
        "Add", logits, graph("Mul", graph("ReduceMax", "mask_input", keepdims=0), given), name="low_res_masks"
    )
    depth = graph("Sub", graph("ReduceMax", colour, keepdims=0), graph("ReduceMin", colour, keepdims=0))
    vivid = graph("Where", graph("Greater", depth, np.float32(0.5)), np.float32(0.9), np.float32(0.3))
    vivid = graph("Add", vivid, graph("Mul", given, np.float32(0.05)))
    quality = graph("Mul", vivid, np.float32([[1.1, 1, 0.5, 0.4]]))
    graph("Identity", quality, name="iou_predictions")
    return graph


def _between(graph: Graph, x: str, low: str, high: str, axis: int, y: str) -> str:
    """(h, w) which cells have their middle within a box."""
    parts = []
    for number, place in ((axis, x), (axis + 1, y)):
        first, last = (graph("Gather", side, np.int64(number)) for side in (low, high))
        parts.append(graph("And", graph("GreaterOrEqual", place, first), graph("Less", place, last)))
    return graph("And", *parts)


def write_box_filler(folder: Path, style: str, slots: bool = False) -> Path:
    """A decoder that gives the box itself, for any number of boxes a call, in three answers of which the second counts.

    Parameters
    ----------
    style : ``efficient-sam``: one graph, which takes the picture; ``transformers``: after an encoder.
    slots : six points a box and labels of one axis more, as in opencv_zoo's EfficientSAM.
    """
    graph, whole = Graph(), style == "efficient-sam"
    labels = graph("Cast", "labels", to=FLOAT)
    labels = labels if slots else graph("Unsqueeze", labels, np.int64([3]))
    corners = []
    for label in (2.0, 3.0):
        chosen = graph("Cast", graph("Equal", labels, np.float32(label)), to=FLOAT)
        corners.append(graph("ReduceSum", graph("Mul", "points", chosen), np.int64([2]), keepdims=0))
    source, scale = ("picture", 1.0) if whole else ("embedding", 0.5)
    shape = {2: [1, 1, -1, 1], 3: [1, 1, 1, -1]}
    inside = []
    for axis, number in ((3, 0), (2, 1)):
        place = graph(
            "Reshape", graph("Add", graph.steps(source, axis), np.float32(0.5)), np.int64(shape[axis])
        )
        low, high = (
            graph(
                "Unsqueeze",
                graph("Mul", graph("Gather", c, np.int64([number]), axis=2), np.float32(scale)),
                np.int64([3]),
            )
            for c in corners
        )
        inside += [graph("GreaterOrEqual", place, low), graph("Less", place, high)]
    mask = graph("And", graph("And", inside[0], inside[1]), graph("And", inside[2], inside[3]))
    logits = graph("Where", graph("Unsqueeze", mask, np.int64([2])), np.float32(8), np.float32(-8))
    graph("Mul", logits, np.float32([-1, 1, -1]).reshape(1, 1, 3, 1, 1), name="logits")
    count = graph("Mul", graph("ReduceSum", labels, np.int64([2]), keepdims=1), np.float32([0, 0, 0]))
    graph("Add", graph("Squeeze", count, np.int64([2])), np.float32([0.1, 0.8, 0.2]), name="quality")
    points: Any = 6 if slots else "points"
    picture = {"picture": (FLOAT, [1, 3, "height", "width"])}
    seen = picture if whole else {"embedding": (FLOAT, [1, 3, "rows", "columns"])}
    axes = [1, "boxes", points]
    inputs = {**seen, "points": (FLOAT, [*axes, 2])}
    inputs["labels"] = (FLOAT if whole else INT, [*axes, 1] if slots else axes)
    outputs = {"logits": (FLOAT, [1, "boxes", 3, "high", "wide"]), "quality": (FLOAT, [1, "boxes", 3])}
    decoder = graph.write(folder / "decoder.onnx", inputs, outputs)
    encoder = Graph()
    encoder("AveragePool", "picture", name="embedding", kernel_shape=[2, 2], strides=[2, 2])
    first = encoder.write(folder / "encoder.onnx", picture, {"embedding": (FLOAT, [1, 3, "rows", "columns"])})
    content = {
        "name": "box-filler",
        "task": "box-masks",
        "graph": {"main": {**decoder, "inputs": {"image": "picture"}}}
        if whole
        else {"encoder": {**first, "inputs": {"image": "picture"}}, "decoder": decoder},
        "input": {**RGB, "resize": {"rule": "stretch", "height": 192, "width": 256}},
        "masks": {"style": style, "boxes_per_call": 2, "upsample": "canvas" if whole else "frame"},
    }
    return write_contract(folder, content)


def write_depth(folder: Path) -> Path:
    """A relative inverse depth at half the size: nearer below, and plain colours nearer than pale ones."""
    graph = Graph()
    coarse = graph("AveragePool", _rgb(graph, "pixel_values"), kernel_shape=[2, 2], strides=[2, 2])
    vivid = graph(
        "Sub",
        graph("ReduceMax", coarse, axes=[1], keepdims=0),
        graph("ReduceMin", coarse, axes=[1], keepdims=0),
    )
    row = graph("Div", graph.steps(coarse, 2), graph.size(coarse, 2))
    ramp = graph("Unsqueeze", graph("Add", row, np.float32(1)), np.int64([1]))
    graph("Add", graph("Mul", vivid, np.float32(0.5)), ramp, name="predicted_depth")
    file = graph.write(
        folder / "depth.onnx",
        {"pixel_values": (FLOAT, [1, 3, "height", "width"])},
        {"predicted_depth": (FLOAT, [1, "rows", "columns"])},
    )
    content = {
        "name": "ramp-depth",
        "task": "depth",
        **file,
        "input": {"tensor": "pixel_values", **IMAGENET, "resize": {"rule": "stretch", "multiple_of": 16}},
        "output": {"tensor": "predicted_depth", "meaning": "inverse-depth"},
    }
    return write_contract(folder, content)


def write_instances(folder: Path, side: int = 256) -> Path:
    """YOLO-shaped: ``predictions`` (1, 4 + 4 + 32, 6) in px of the letterbox and ``prototypes`` at a quarter of it.

    A candidate for each colour, with its own prototype, and two that are nothing.
    """
    graph = Graph()
    hits = _hits(graph, "images")
    sides = [_middle_and_size(graph, _extent(graph, hits, axis), None) for axis in (2, 1)]
    (x, wide), (y, high) = sides
    found = graph("Cast", _found(graph, hits), to=FLOAT)
    score = graph(
        "Mul", np.eye(4, dtype=np.float32) * np.float32(0.9), graph("Unsqueeze", found, np.int64([0]))
    )
    coefficients = np.eye(4, 32, dtype=np.float32)
    rows = graph("Concat", x, y, wide, high, score, coefficients, axis=1)
    table = graph("Concat", rows, np.full((2, 40), 0.01, np.float32), axis=0)
    graph("Unsqueeze", graph("Transpose", table, perm=[1, 0]), np.int64([0]), name="predictions")
    coarse = graph(
        "AveragePool", graph("Unsqueeze", hits, np.int64([0])), kernel_shape=[4, 4], strides=[4, 4]
    )
    logits = graph("Sub", graph("Mul", coarse, np.float32(16)), np.float32(8))
    graph("Pad", logits, np.int64([0, 0, 0, 0, 0, 28, 0, 0]), name="prototypes")
    file = graph.write(
        folder / "instances.onnx",
        {"images": (FLOAT, [1, 3, side, side])},
        {
            "predictions": (FLOAT, [1, 40, 6]),
            "prototypes": (FLOAT, [1, 32, side // 4, side // 4]),
        },
    )
    resize = {"rule": "letterbox", "long_side": side, "pad_value": [114, 114, 114]}
    content = {
        "name": "instances",
        "task": "instance-masks",
        **file,
        "input": {"tensor": "images", **RGB, "resize": resize},
        "output": [{"tensor": "predictions"}, {"tensor": "prototypes"}],
        "instances": {"categories": list(COLOURS)},
    }
    return write_contract(folder, content)


def coloured_clip(frames: int, height: int, width: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Squares, nearly plain, that move by themselves before a panning camera's textured background.

    Red moves right, green left, yellow right; blue comes in from the right in the middle of the clip.

    Returns
    -------
    images : (T, H, W, 3) uint8 BGR.
    truth : (T, H, W) uint8: 1 red, 2 green, 3 blue, 4 yellow.
    """
    world = textured(np.random.default_rng(seed), height, width + frames, (110, 130, 90))
    side, lane = min(height, width) // 5, height // 4
    skins = [np.zeros(0), *(_skin(side, colour, number) for number, colour in enumerate(COLOURS.values(), 1))]
    room = width - side
    images, truth = [], np.zeros((frames, height, width), np.uint8)
    for t in range(frames):
        image = world[:, t : t + width].copy()
        left = {
            1: _bounced(width // 20 + 3 * t, room),
            2: _bounced(room - width // 20 - 5 * t, room),
            3: width - _bounced(5 * (t - frames // 2), width) if t > frames // 2 else width,
            4: _bounced(width // 3 + 2 * t, room),
        }
        for number in range(1, len(COLOURS) + 1):
            top = lane * (number - 1) + (lane - side) // 2
            shown = slice(top, top + side), slice(left[number], min(left[number] + side, width))
            image[shown] = skins[number][:, : shown[1].stop - shown[1].start]
            truth[t][shown] = number
        images.append(image)
    return np.stack(images), truth


def _skin(side: int, colour: tuple[int, ...], seed: int) -> np.ndarray:
    """(side, side, 3) BGR: a colour with a texture that flow can follow, well within what the graphs take for it."""
    rough = textured(np.random.default_rng(seed), side, side, (128, 128, 128)).astype(np.float32)
    away = 36 * (rough - rough.min()) / (rough.max() - rough.min())
    pure = np.array([255 * part for part in colour[::-1]], np.float32)
    return np.abs(pure - away).astype(np.uint8)


def _bounced(place: int, room: int) -> int:
    """A place that turns back at 0 and at ``room``."""
    return room - abs(place % (2 * room) - room)
