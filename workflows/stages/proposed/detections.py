"""Stage ``detections``: what networks say of the frames that they look at, before thresholds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from zsmoseg import settings
from zsmoseg.formats.rle import packed
from zsmoseg.networks.box_masks import embed, masks_of_boxes, masks_of_points, point_grid
from zsmoseg.networks.instance_masks import categories_of, network_instances
from zsmoseg.networks.references import contract_at
from zsmoseg.networks.tags import chosen_tags, tag_thresholds
from zsmoseg.networks.text_boxes import prompts_for, text_boxes
from zsmoseg.proposals.candidates import ranked
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.fields import table
from zsmoseg.workflows.stage import Part, Stage, reach
from zsmoseg.workflows.stages.cues.flow import Flow
from zsmoseg.workflows.stages.proposed.looks import looks, span_of
from zsmoseg.workflows.stages.proposed.naming import categories, tag_list
from zsmoseg.workflows.stages.proposed.tags import Tags

Floats = NDArray[np.float32]
Ids = NDArray[np.int64]


@dataclass(frozen=True)
class Detections(Arrays):
    """The candidates of all frames that were looked at, one behind the other, the best of a frame first."""

    labels: ClassVar[Mapping[str, Sequence[str]]] = {"edge": ("left", "top", "right", "bottom")}

    looked: NDArray[np.bool_] = table("frame", dtype="bool", meaning="whether networks looked at the frame")
    candidates: Ids = table("frame", dtype="int64", meaning="how many candidates it has")
    box: Floats = table("candidate", "edge", dtype="float32", meaning="box of the candidate", unit="px")
    category_of: Ids = table(
        "candidate", "rank", dtype="int64", meaning="its best categories, index of the coordinate; -1 = none"
    )
    score: Floats = table("candidate", "rank", dtype="float32", meaning="their scores")
    quality: Floats = table("candidate", dtype="float32", meaning="overlap with the truth that is predicted")
    stability: Floats = table("candidate", dtype="float32", meaning="area of the sure over the possible part")
    length: Ids = table("candidate", dtype="int64", meaning="bytes of its mask in run")
    run: NDArray[np.uint8] = table(
        "byte", dtype="uint8", meaning="masks as COCO's run lengths, displayed size"
    )
    named: Ids = table("category", dtype="int64", meaning="candidates whose best it is", add=True)


@dataclass(frozen=True)
class Inputs:
    """What is read."""

    flow: Flow = reach()
    tags: Tags = reach()


@dataclass(frozen=True)
class Sections:
    """The settings that are read."""

    looks: settings.Looks
    proposals: settings.Proposals
    tags: settings.Tags


@dataclass(frozen=True)
class Found:
    """The candidates of one frame: box (n, 4), score (n, categories), masks packed (``rle.packed``)."""

    box: Floats
    score: Floats
    masks: tuple[Ids, NDArray[np.uint8]]
    quality: Floats
    stability: Floats


Backend = Callable[[Part, Inputs, Sections, Ids], Iterator[Found]]
"""Yields the candidates of each of some frames."""


def _instances(part: Part, inputs: Inputs, s: Sections, seen: Ids) -> Iterator[Found]:
    network = part.network(s.proposals.model)
    named = bool(categories_of(network.contract))
    found = network_instances(network, map(part.read, map(int, seen)), part.batch)
    for t in map(int, seen):
        with part.at_frame(t):
            raw = next(found)
        unknown = np.full(len(raw.box), np.nan, np.float32)
        score = raw.score if named else raw.score.max(1, keepdims=True)
        yield Found(raw.box, score, packed(raw.mask), unknown, unknown)


def _grid(part: Part, inputs: Inputs, s: Sections, seen: Ids) -> Iterator[Found]:
    network = part.network(s.proposals.model)
    points = point_grid(s.proposals.points, *part.displayed)
    for t in map(int, seen):
        with part.at_frame(t):
            masks = masks_of_points(network, embed(network, part.read(t)), points)
        yield Found(
            _boxes(masks.mask), masks.quality[:, None], packed(masks.mask), masks.quality, masks.stability
        )


def _boxes(masks: NDArray[np.bool_]) -> Floats:
    """(n, 4) the boxes of masks (n, H, W) that are not empty."""
    edges = []
    for mask in masks:
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        edges.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
    return np.array(edges, np.float32).reshape(-1, 4)


def _text(part: Part, inputs: Inputs, s: Sections, seen: Ids) -> Iterator[Found]:
    names, network = tag_list(s.tags), part.network(s.proposals.boxes)
    on = dict(_tags_on(part, inputs, s))
    for t in map(int, seen):
        score = np.zeros((0, len(names)), np.float32)
        box, masks = np.zeros((0, 4), np.float32), np.zeros((0, *part.displayed), np.bool_)
        if len(on[t]):
            with part.at_frame(t):
                frame, prompts = part.read(t), prompts_for(network.contract, [names[n] for n in on[t]])
                raw = text_boxes(network, frame, prompts)
                box, score = raw.box, np.zeros((len(raw.box), len(names)), np.float32)
                score[:, on[t]] = raw.phrase_score
                if len(box):
                    segmenter = part.network(s.proposals.masks)
                    masks = masks_of_boxes(segmenter, embed(segmenter, frame), box).mask
                part.facts["outside"] = part.facts.get("outside", 0) + raw.outside
        unknown = np.full(len(box), np.nan, np.float32)
        yield Found(box, score, packed(masks), unknown, unknown)


def _tags_on(part: Part, inputs: Inputs, s: Sections) -> Iterator[tuple[int, Ids]]:
    """Of each frame that is looked at the tags that are on."""
    thresholds = (
        np.zeros(len(tag_list(s.tags)), np.float32)
        if s.tags.prompt
        else tag_thresholds(contract_at(s.tags.model))
    )
    # parts of tags may be cut otherwise than ours, by another chunk length: whole blocks, and of them our frames
    for block in inputs.tags.blocks():
        for t, scores in zip(block.look, block.probability, strict=True):
            if part.start <= t < part.stop:
                yield int(t), chosen_tags(scores, thresholds)


def _backend(s: Sections) -> Backend:
    if not s.proposals.model:
        return _text
    return _instances if contract_at(s.proposals.model).task == "instance-masks" else _grid


def task(part: Part, inputs: Inputs, s: Sections) -> Iterator[Detections]:
    """Candidates of one chunk; the fact ``outside`` counts boxes that lay outside of their frame."""
    seen = looks(inputs.flow, part.start, part.stop, span_of(s))
    found = list(_backend(s)(part, inputs, s, seen))
    looked = np.isin(np.arange(part.start, part.stop), seen)
    counts = np.zeros(part.stop - part.start, np.int64)
    counts[seen - part.start] = [len(f.box) for f in found]
    best = [ranked(f.score) for f in found]
    first = np.concatenate([category[:, 0] for category, _ in best])
    yield Detections(
        start=part.start,
        stop=part.stop,
        looked=looked,
        candidates=counts,
        box=np.concatenate([f.box for f in found]).astype(np.float32),
        category_of=np.concatenate([category for category, _ in best]),
        score=np.concatenate([score for _, score in best]),
        quality=np.concatenate([f.quality for f in found]).astype(np.float32),
        stability=np.concatenate([f.stability for f in found]).astype(np.float32),
        length=np.concatenate([f.masks[0] for f in found]),
        run=np.concatenate([f.masks[1] for f in found]),
        named=np.bincount(first, minlength=len(categories(s.proposals, s.tags))).astype(np.int64),
    )


def _labels(s: Sections) -> Mapping[str, Sequence[str]]:
    return {"category": categories(s.proposals, s.tags)}


STAGE = Stage(
    "detections", 1, task, Inputs, Sections, Detections, labels=_labels, span=span_of, cost=(250.0, 5.0)
)
