"""Boxes of what phrases name: Grounding DINO in either of its two exported forms.

Each phrase is scored at its own tokens (the largest sigmoid over its span), so a label is always one of the
phrases asked for; the text threshold and the decoding of tokens of the authors' demo are not needed. Thresholds come
later: what leaves here is every candidate above a low floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from zsmoseg.errors import ModelError
from zsmoseg.networks.boxes import suppress
from zsmoseg.networks.contract import MAIN, Contract, File, Table
from zsmoseg.networks.image import Geometry, prepare
from zsmoseg.networks.prompts import MOST_TOKENS, Prompt, padded, prompts_of, tokenizer_of
from zsmoseg.networks.session import Network, verified

Floats = NDArray[np.float32]


class TextTable(Table):
    """``[text]`` of a contract.

    Attributes
    ----------
    vocabulary : ``vocab.txt`` or ``tokenizer.json``.
    phrases : ``one`` where the graph's mask of phrases was fixed to a single phrase when it was exported.
    most_tokens : of a prompt.
    """

    vocabulary: File
    phrases: Literal["one", "several"] = "several"
    most_tokens: int = MOST_TOKENS


@dataclass(frozen=True)
class Candidates:
    """Which boxes are worth keeping before any threshold of the settings; none of them changes what is found.

    Attributes
    ----------
    floor : best score of a phrase, below every threshold in use (authors 0.35, SAM-Track 0.25).
    most : boxes of a frame, best first.
    overlap : IoU above which the weaker of two boxes is the same box again, whatever its phrase.
    """

    floor: float = 0.1
    most: int = 100
    overlap: float = 0.8


@dataclass(frozen=True)
class RawBoxes:
    """Candidates of one frame, best first.

    Attributes
    ----------
    box : (n, 4) left, top, right, bottom, px of the frame, within it.
    phrase_score : (n, P) of every phrase in 0..1; 0 for the phrases of other prompts than the box's own.
    outside : boxes that lay outside the frame and were dropped.
    """

    box: Floats
    phrase_score: Floats
    outside: int


def prompts_for(contract: Contract, phrases: Sequence[str]) -> list[Prompt]:
    """Phrases as prompts of a model, with its vocabulary; one each where its graph cannot tell phrases apart."""
    table = contract.extra("text", TextTable)
    tokenizer = tokenizer_of(verified(contract.folder, table.vocabulary), table.vocabulary.file)
    return prompts_of(phrases, tokenizer, table.most_tokens, alone=table.phrases == "one")


def text_boxes(
    network: Network,
    frame: NDArray[np.uint8],
    prompts: Sequence[Prompt],
    candidates: Candidates = Candidates(),
) -> RawBoxes:
    """Boxes of what the prompts name.

    Parameters
    ----------
    network : of task ``text-boxes``.
    frame : (H, W, 3) BGR.
    prompts : see :func:`prompts_for`; the phrases of all together are numbered 0..P-1.

    Raises
    ------
    ModelError
        The graph takes one phrase a call and a prompt has several, or its text is of a fixed, smaller length.
    """
    contract = network.contract
    tensor, geometry = prepare(frame, contract.image)
    phrases = sum(len(prompt.phrases) for prompt in prompts)
    boxes, scores = [np.zeros((0, 4), np.float32)], [np.zeros((0, phrases), np.float32)]
    for prompt in prompts:
        box, score = _ask(network, tensor, geometry, prompt)
        every = np.zeros((len(box), phrases), np.float32)
        every[:, list(prompt.phrases)] = score
        above = every.max(1) > candidates.floor
        boxes.append(box[above])
        scores.append(every[above])
    return _tidy(np.concatenate(boxes), np.concatenate(scores), frame.shape[:2], candidates)


def _ask(network: Network, tensor: Floats, geometry: Geometry, prompt: Prompt) -> tuple[Floats, Floats]:
    """(q, 4) boxes in px of the frame and (q, phrases of the prompt) scores."""
    contract = network.contract
    if len(prompt.phrases) > 1 and contract.extra("text", TextTable).phrases == "one":
        raise ModelError(f"{contract.name} takes one phrase a call, the prompt has {len(prompt.phrases)}")
    out = network.run(MAIN, _feeds(network, tensor, geometry, prompt), ["logits", "boxes"])
    probability = scipy.special.expit(out["logits"][0].astype(np.float32))
    score = np.stack([probability[:, a:b].max(1) for a, b in prompt.spans], 1)
    centre, size = np.split(out["boxes"][0].astype(np.float32), 2, axis=1)
    box = np.hstack([centre - size / 2, centre + size / 2]).astype(np.float32)
    # With a mask of pixels the network counts from the picture inside the canvas, without it from the canvas.
    if "pixel_mask" in network.inputs(MAIN):
        height, width = geometry.original
        return (box * np.array([width, height, width, height])).astype(np.float32), score
    height, width = geometry.canvas
    return geometry.boxes_out(box * np.array([width, height, width, height])), score


def _feeds(
    network: Network, tensor: Floats, geometry: Geometry, prompt: Prompt
) -> dict[str, NDArray[np.generic]]:
    """What the graph has inputs for; the text padded where its length is fixed."""
    length = network.shape(MAIN, "input_ids")[1]
    tokens = prompt.input_ids.shape[1]
    if isinstance(length, int):
        if tokens > length:
            raise ModelError(
                f"{network.contract.name} takes {length} tokens, the prompt has {tokens}: set [text] most_tokens"
                f" = {length} in its contract"
            )
        prompt = padded(prompt, length)
    pixels = np.zeros((1, *geometry.canvas), np.int64)
    height, width = geometry.resized
    pixels[:, geometry.top : geometry.top + height, geometry.left : geometry.left + width] = 1
    every: dict[str, NDArray[np.generic]] = {
        "image": tensor,
        "pixel_mask": pixels,
        "input_ids": prompt.input_ids,
        "token_type_ids": prompt.token_type_ids,
        "attention_mask": prompt.attention_mask,
        "position_ids": prompt.position_ids,
        "text_token_mask": prompt.text_token_mask,
    }
    roles = network.inputs(MAIN)
    if "text_token_mask" in roles:  # the authors' own form, whose mask of tokens is of bits, too
        every["attention_mask"] = prompt.attention_mask.astype(bool)
    return {role: every[role] for role in roles if role in every}


def _tidy(box: Floats, score: Floats, shape: tuple[int, int], candidates: Candidates) -> RawBoxes:
    """Clipped to the frame, best first, without those outside and those that are there already."""
    height, width = shape
    box = np.clip(box, 0, np.array([width, height, width, height], np.float32))
    inside = ((box[:, 2:] - box[:, :2]) > 0).all(1)
    outside = int((~inside).sum())
    box, score = box[inside], score[inside]
    kept = suppress(box, score.max(1, initial=0), candidates.overlap)[: candidates.most]
    return RawBoxes(box[kept], score[kept], outside)
