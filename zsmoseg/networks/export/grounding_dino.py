"""Grounding DINO from a folder of transformers: boxes of what phrases name, for any number of phrases.

Liu et al., "Grounding DINO: Marrying DINO with Grounded Pre-Training for Open-Set Object Detection", ECCV 2024. The
text may have any length; the picture has the size of the export, for the positions of its cells are numbers in the
graph, and another size would run and give wrong boxes. So the size is written into the graph's inputs.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    load_folder,
    noise,
    require,
    save_graph,
    sized,
    verified_dynamic,
    write_contract,
)
from zsmoseg.networks.prompts import MOST_TOKENS, prompts_of, tokenizer_of

MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
"""Of ImageNet, RGB from 0 to 1."""
HEIGHT, WIDTH = 800, 1333
"""px of the picture, as the authors have it for wide frames."""
PHRASES = (2, 1, 40)
"""In the text of the export, and in those of its comparison."""
LOWEST = -1e4
"""In place of minus infinity for tokens that are not there: the same 0 as a probability."""
INPUTS = ("pixel_values", "input_ids", "token_type_ids", "attention_mask", "pixel_mask")


def export_grounding_dino(
    source: Path, folder: Path, name: str = "grounding-dino", height: int = HEIGHT, width: int = WIDTH
) -> Path:
    """Graph, vocabulary and contract of Grounding DINO; returns the contract's path.

    Parameters
    ----------
    source
        Folder with ``config.json``, ``model.safetensors`` and ``vocab.txt`` of ``IDEA-Research/grounding-dino-*``.
    height, width
        px of the picture that the graph takes; frames are fitted into it and padded.

    Raises
    ------
    ModelError
        The folder holds another model, or the graph gives other values than torch, with few phrases or with many.
    """
    require("transformers")
    from transformers import GroundingDinoForObjectDetection

    if not (source / "vocab.txt").is_file():
        raise ModelError(f"{source}: has no vocab.txt; take it from where the weights are from")
    model = load_folder(GroundingDinoForObjectDetection, source)
    network = as_module(lambda *tensors: _forward(model, *tensors), model)
    examples = [_example(source, count, height, width) for count in PHRASES]
    path = folder / f"{name}.onnx"
    words = {key: {1: "tokens"} for key in INPUTS[1:4]}
    axes = {INPUTS[0]: {2: "height", 3: "width"}, INPUTS[4]: {1: "height", 2: "width"}, **words}
    with _phrases_apart():
        export_graph(network, examples[0], path, INPUTS, ["logits", "pred_boxes"], axes)
    _pin(path, {"height": height, "width": width})
    if not verified_dynamic(network, path, examples[1:]):
        raise ModelError(f"{path}: with {PHRASES[1]} or {PHRASES[2]} phrases its values are not torch's")
    shutil.copyfile(source / "vocab.txt", folder / "vocab.txt")
    graph = {"file": path.name, "inputs": {"image": INPUTS[0]}, "outputs": {"boxes": "pred_boxes"}}
    resize = {"rule": "letterbox", "height": height, "width": width}
    content = {
        "name": name,
        "task": "text-boxes",
        "licence": "Apache-2.0",
        "commercial": True,
        "source": "https://github.com/IDEA-Research/GroundingDINO",
        "graph": {"main": graph},
        "input": {
            "colour_order": "RGB",
            "scale": 1 / 255,
            "mean": MEAN,
            "std": STD,
            "resize": {**resize, "pad": "bottom-right", "interpolation": "antialias"},
        },
        "text": {"vocabulary": sized(folder, "vocab.txt"), "most_tokens": MOST_TOKENS},
    }
    return write_contract(folder, content)


def _forward(model: Any, pixels: Any, ids: Any, types: Any, attention: Any, mask: Any) -> tuple[Any, Any]:
    out = model(
        pixel_values=pixels, input_ids=ids, token_type_ids=types, attention_mask=attention, pixel_mask=mask
    )
    return out.logits.clamp(min=LOWEST), out.pred_boxes


def _example(source: Path, count: int, height: int, width: int) -> list[Any]:
    """Noise, and a text of so many phrases."""
    import torch

    tokenizer = tokenizer_of((source / "vocab.txt").read_bytes(), "vocab.txt")
    words = ("dog", "red car", "person", "tree")
    prompt = prompts_of([words[i % len(words)] for i in range(count)], tokenizer)[0]
    ids, types, mask = map(torch.from_numpy, (prompt.input_ids, prompt.token_type_ids, prompt.attention_mask))
    picture = noise(1, (height, width)) * 4 - 2
    return [picture, ids, types, mask, torch.ones(1, height, width, dtype=torch.int64)]


@contextmanager
def _phrases_apart() -> Iterator[None]:
    """The mask of phrases from operators that ONNX has, in place of isin, cummax and flip, while a graph is traced."""
    from transformers.models.grounding_dino import modeling_grounding_dino as modelling

    name = "generate_masks_with_special_tokens_and_transfer_map"
    if not hasattr(modelling, name):
        raise ModelError(
            f"transformers has no {name} in Grounding DINO any more; install the version of zsmoseg[export]"
        )
    theirs = getattr(modelling, name)
    setattr(modelling, name, phrase_mask)
    try:
        yield
    finally:
        setattr(modelling, name, theirs)


def phrase_mask(input_ids: Any, special_tokens: Any) -> tuple[Any, Any]:
    """Which tokens attend to which, and their positions within their phrases.

    Parameters
    ----------
    input_ids
        (1, T) tokens.
    special_tokens
        (k,) those that end a phrase: [CLS], [SEP], "." and "?".

    Returns
    -------
    mask : (1, T, T) bool, in a block a phrase and what ends it; the ends of the text attend to themselves.
    positions : (1, T) int64, from 0 in each phrase.
    """
    import torch

    length = input_ids.shape[1]
    place = torch.arange(length)
    ends = (input_ids[:, :, None] == torch.as_tensor(special_tokens)).any(-1)  # (1, T)
    behind = place[None, :] >= place[:, None]
    before = place[None, :] < place[:, None]
    nothing = torch.full_like(place, -1)
    # of every token the end at or behind it, and the end before it: reductions over a grid of T x T
    last = torch.where(behind & ends[:, None, :], place, torch.full_like(place, length)).amin(-1)
    first = torch.where(before & ends[:, None, :], place, nothing).amax(-1)
    within = (last != 0) & (last < length - 1)
    mask = ((last[:, :, None] == last[:, None, :]) & within[:, None, :]) | (place[:, None] == place)
    return mask, torch.where(within, place - first - 1, torch.zeros_like(first))


def _pin(path: Path, sides: dict[str, int]) -> None:
    """Write numbers where the graph's inputs have names of sides."""
    import onnx

    graph = onnx.load(str(path))
    for tensor in graph.graph.input:
        for side in tensor.type.tensor_type.shape.dim:
            if side.dim_param in sides:
                side.dim_value = sides[side.dim_param]
    save_graph(graph, path)
