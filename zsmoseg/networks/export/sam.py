"""SAM and SAM 2 from folders of transformers, SAM and MobileSAM from the authors' checkpoints: masks of boxes.

Kirillov et al., "Segment Anything", ICCV 2023; Ravi et al., "SAM 2: Segment Anything in Images and Videos", ICLR 2025;
Zhang et al., "Faster Segment Anything" (MobileSAM), 2023. Two graphs each: the encoder runs once a frame, the decoder
once for some boxes. In both the size of the picture is fixed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.export.common import (
    as_module,
    export_graph,
    fill,
    load_folder,
    load_weights,
    noise,
    require,
    verified_dynamic,
    write_contract,
)

MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
"""Of ImageNet, RGB from 0 to 1; SAM's own numbers are these times 255, rounded."""
SAM_MEAN, SAM_STD = [123.675, 116.28, 103.53], [58.395, 57.12, 57.375]
"""Of SAM's own code, RGB from 0 to 255."""
BOXES = 8
"""A call of decoders that take several: what is gained ends there, memory goes on."""
WIDTHS = {768: "vit_b", 1024: "vit_l", 1280: "vit_h"}
"""SAM's encoders by the length of their tokens."""
TINY = "image_encoder.patch_embed.seq.0.c.weight"
"""A weight that MobileSAM's encoder has."""
EMBEDDING = "image_embeddings"


def export_sam(source: Path, folder: Path, name: str = "") -> Path:
    """Graphs and contract of SAM, SAM 2 or MobileSAM; returns the contract's path.

    Parameters
    ----------
    source
        Folder with ``config.json`` and ``model.safetensors`` of ``facebook/sam-*`` or ``facebook/sam2*-hiera-*``; or
        ``sam_vit_*.pth`` (needs the package segment-anything) or ``mobile_sam.pt`` (needs mobile_sam).
    name
        Of the model; sam, sam2 or mobile-sam without it.

    Raises
    ------
    ModelError
        It is another model, a package is missing, or a graph gives other values than torch.
    """
    if source.is_file():
        model, kind = _of_the_authors(source)
        return export_meta_sam(model, folder, name or kind)
    require("transformers")
    from transformers import Sam2Model, SamModel

    try:
        second = "sam2" in json.loads((source / "config.json").read_text(encoding="utf-8"))["model_type"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelError(
            f"{source}: no readable config.json; give the folder of a model, or a file"
        ) from error
    if second:
        return export_sam2(load_folder(Sam2Model, source), folder, name or "sam2")
    return export_hugging_face_sam(load_folder(SamModel, source), folder, name or "sam")


def export_hugging_face_sam(model: Any, folder: Path, name: str) -> Path:
    """Graphs and contract of a ``SamModel``."""
    side = int(model.config.vision_config.image_size)
    encoder = as_module(lambda pixels: model.vision_encoder(pixels)[0], model)
    decoder = as_module(
        lambda points, labels, embedding: _decoded(model, points, labels, [embedding], pad=False), model
    )
    resize = {"rule": "long-side", "long_side": side, "pad": "bottom-right", "interpolation": "antialias"}
    return _two_graphs(encoder, decoder, [EMBEDDING], side, folder, name, resize, {"upsample": "canvas"})


def export_sam2(model: Any, folder: Path, name: str) -> Path:
    """Graphs and contract of a ``Sam2Model``, for pictures one by one."""
    side = int(model.prompt_encoder.input_image_size)
    encoder = as_module(lambda pixels: tuple(model.get_image_embeddings(pixels)), model)
    decoder = as_module(
        lambda points, labels, *embeddings: _decoded(model, points, labels, embeddings, pad=True), model
    )
    names = ["high_res_feats_0", "high_res_feats_1", EMBEDDING]
    # SAM 2's own code shrinks numbers, not bytes
    resize = {"rule": "stretch", "height": side, "width": side, "interpolation": "antialias", "on": "float32"}
    rules = {"upsample": "frame", "pad_point": False}
    return _two_graphs(encoder, decoder, names, side, folder, name, resize, rules)


def _decoded(model: Any, points: Any, labels: Any, embeddings: Sequence[Any], pad: bool) -> tuple[Any, Any]:
    """Predicted IoU and low-resolution logits of prompts; SAM 2 has a point of label -1 behind every prompt."""
    import torch

    prompts = model.prompt_encoder
    if pad:
        points = torch.nn.functional.pad(points, (0, 0, 0, 1))
        labels = torch.nn.functional.pad(labels, (0, 1), value=-1)
    size = (int(prompts.input_image_size), int(prompts.input_image_size))
    code = prompts.shared_embedding(points + 0.5, size)
    kinds = prompts.point_embed
    known = kinds.weight if hasattr(kinds, "weight") else torch.cat([kind.weight for kind in kinds])
    sparse = code + known[labels.clamp(min=0)]
    sparse = torch.where(labels[..., None] < 0, prompts.not_a_point_embed.weight[0], sparse)
    height, width = embeddings[-1].shape[-2:]
    dense = prompts.no_mask_embed.weight.reshape(1, -1, 1, 1).expand(1, -1, height, width)
    fine = {"high_resolution_features": list(embeddings[:-1])} if len(embeddings) > 1 else {}
    logits, quality = model.mask_decoder(
        image_embeddings=embeddings[-1],
        image_positional_embeddings=model.get_image_wide_positional_embeddings(),
        sparse_prompt_embeddings=sparse,
        dense_prompt_embeddings=dense,
        multimask_output=True,
        **fine,
    )[:2]
    return quality, logits


def _two_graphs(
    encoder: Any,
    decoder: Any,
    names: Sequence[str],
    side: int,
    folder: Path,
    name: str,
    resize: Mapping[str, Any],
    rules: Mapping[str, Any],
) -> Path:
    """Graphs in the form of transformers' ``vision_encoder`` and ``prompt_encoder_mask_decoder``."""
    import torch

    picture = noise(1, (side, side)) * 4 - 2
    files = {part: folder / f"{name}.{part}.onnx" for part in ("encoder", "decoder")}
    export_graph(encoder, [picture], files["encoder"], ["pixel_values"], names)
    with torch.no_grad():
        embeddings = encoder(picture)
    embeddings = [embeddings] if torch.is_tensor(embeddings) else list(embeddings)
    inputs, outputs = ["input_points", "input_labels", *names], ["iou_scores", "pred_masks"]
    free = {1: "prompts", 2: "points"}
    axes = {"input_points": free, "input_labels": free} | {key: {1: "prompts"} for key in outputs}
    export_graph(decoder, [*_prompts(1, side), *embeddings], files["decoder"], inputs, outputs, axes)
    several = verified_dynamic(decoder, files["decoder"], [[*_prompts(3, side), *embeddings]])
    graphs = {
        "encoder": {"file": files["encoder"].name, "inputs": {"image": "pixel_values"}},
        "decoder": {
            "file": files["decoder"].name,
            "inputs": {"points": "input_points", "labels": "input_labels"},
            "outputs": {"logits": "pred_masks", "quality": "iou_scores"},
        },
    }
    masks = {"style": "transformers", "boxes_per_call": BOXES if several else 1, **rules}
    scaling = {"scale": 1 / 255, "mean": MEAN, "std": STD}
    return _contract(folder, name, graphs, {**scaling, "resize": resize}, masks)


def _prompts(count: int, side: int) -> list[Any]:
    """Boxes (1, count, 2, 2) and the labels of their corners."""
    import torch

    low = torch.linspace(0.1, 0.3, count)[None, :, None, None] * side
    points = low + torch.tensor([[0.0, 0.0], [0.4, 0.5]]) * side
    return [points, torch.tensor([2, 3]).expand(1, count, 2).contiguous()]


def export_meta_sam(model: Any, folder: Path, name: str) -> Path:
    """Graphs and contract of a ``Sam`` of segment-anything or mobile_sam: the decoder of their own exports."""
    require("segment_anything")
    import torch
    from segment_anything.utils.onnx import SamOnnxModel

    side = int(model.image_encoder.img_size)
    theirs = SamOnnxModel(model, return_single_mask=False)
    files = {part: folder / f"{name}.{part}.onnx" for part in ("encoder", "decoder")}
    picture = noise(1, (side, side)) * 4 - 2
    export_graph(model.image_encoder, [picture], files["encoder"], ["image"], [EMBEDDING])
    with torch.no_grad():
        embedding = model.image_encoder(picture)
    decoder = as_module(lambda *tensors: _meta_decoded(theirs, *tensors), theirs)
    points, labels = (prompt[0] for prompt in _prompts(1, side))
    low = [4 * part for part in embedding.shape[-2:]]
    prior = [torch.zeros(1, 1, *low), torch.zeros(1)]
    inputs = [EMBEDDING, "point_coords", "point_labels", "mask_input", "has_mask_input"]
    axes = {"point_coords": {1: "points"}, "point_labels": {1: "points"}}
    args = [embedding, points, labels.float(), *prior]
    export_graph(decoder, args, files["decoder"], inputs, ["iou_predictions", "low_res_masks"], axes)
    four = [torch.cat([points, points + 9], 1), torch.tensor([[1.0, 0, 1, -1]])]
    given = [torch.rand(1, 1, *low, generator=torch.Generator().manual_seed(0)) * 8 - 4, torch.ones(1)]
    if not verified_dynamic(decoder, files["decoder"], [[embedding, *four, *given]]):
        raise ModelError(f"{files['decoder']}: with other points its values are not torch's")
    graphs = {
        "encoder": {"file": files["encoder"].name},
        "decoder": {
            "file": files["decoder"].name,
            "inputs": {"points": "point_coords", "labels": "point_labels"},
            "outputs": {"logits": "low_res_masks", "quality": "iou_predictions"},
        },
    }
    resize = {"rule": "long-side", "long_side": side, "pad": "bottom-right", "interpolation": "antialias"}
    image = {"scale": 1.0, "mean": SAM_MEAN, "std": SAM_STD, "resize": resize}
    return _contract(folder, name, graphs, image, {"style": "sam"})


def _meta_decoded(
    theirs: Any, embedding: Any, points: Any, labels: Any, prior: Any, given: Any
) -> tuple[Any, Any]:
    """Without the growing of the masks at the end of their own graph, which is done on the frame's geometry here."""
    logits, quality = theirs.mask_decoder.predict_masks(
        image_embeddings=embedding,
        image_pe=theirs.model.prompt_encoder.get_dense_pe(),
        sparse_prompt_embeddings=theirs._embed_points(points, labels),
        dense_prompt_embeddings=theirs._embed_masks(prior, given),
    )
    return quality, logits


def _of_the_authors(path: Path) -> tuple[Any, str]:
    """The torch module of a checkpoint, by what is in it, and its usual name."""
    weights = load_weights(path)
    if TINY in weights:
        require("mobile_sam")
        from mobile_sam import sam_model_registry as mobile

        return fill(mobile["vit_t"](), weights, path), "mobile-sam"
    require("segment_anything")
    from segment_anything import sam_model_registry

    first = weights.get("image_encoder.patch_embed.proj.weight")
    kind = WIDTHS.get(0 if first is None else len(first))
    if kind is None:
        raise ModelError(f"{path}: is no SAM (ViT-B, L, H) and no MobileSAM; give one of their checkpoints")
    return fill(sam_model_registry[kind](), weights, path), f"sam-{kind.replace('_', '-')}"


def _contract(
    folder: Path, name: str, graphs: Mapping[str, Any], image: Mapping[str, Any], masks: Mapping[str, Any]
) -> Path:
    source = "https://github.com/facebookresearch/segment-anything"
    about = {"licence": "Apache-2.0", "commercial": True, "source": source}
    content = {
        "name": name,
        "task": "box-masks",
        **about,
        "graph": graphs,
        "input": {"colour_order": "RGB", **image},
        "masks": masks,
    }
    return write_contract(folder, content)
