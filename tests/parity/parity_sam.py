"""SAM, SAM 2, MobileSAM, EfficientSAM: our picture, graphs and masks against the references' own, on a real frame.

    python tests/parity/parity_sam.py [FOLDER_WITH_mobile_sam] [FOLDER_WITH_efficient_sam]

with clones of ChaoningZhang/MobileSAM and yformer/EfficientSAM for the last two. Random weights, tiny where the
reference allows it. Two boxes, a third that reaches beyond the frame (the references get it cut), and two points.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rows import BOXES, frame, iou, row, shaken

from zsmoseg.networks.box_masks import CORNERS, POINT, _answers, embed, logits_of_frame, masks_of_boxes
from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.decoders import MasksTable
from zsmoseg.networks.export.sam import export_meta_sam, export_sam
from zsmoseg.networks.session import Network

POINTS = np.float32([[200, 240], [610.5, 130.25]])
CUT = np.clip(BOXES, 0, [854, 480, 854, 480]).astype(np.float32)


def compare(
    model: str, reference: str, what: str, network: Network, prompts: np.ndarray, wanted: Any
) -> None:
    """``wanted``: full logits (n, m, H, W) and predicted IoU (n, m) of the reference."""
    logits, quality = (np.asarray(part, np.float32) for part in wanted)
    bgr, _ = frame()
    embedding = embed(network, bgr)
    upsample = network.contract.extra("masks", MasksTable).upsample
    points = prompts.reshape(len(prompts), -1, 2)
    labels = CORNERS if points.shape[1] == 2 else POINT
    worst, same, scores = 0.0, 1.0, 0.0
    for index, ours, predicted in _answers(network, embedding, points, labels):
        full = np.stack([logits_of_frame(part, embedding.geometry, upsample) for part in ours])
        worst = max(worst, float(np.abs(full - logits[index]).max()))
        scores = max(scores, float(np.abs(predicted - quality[index]).max()))
        same = min([same, *(iou(a > 0, b > 0) for a, b in zip(full, logits[index], strict=True))])
    on = (logits > 0).mean((-2, -1))
    spread = f"logits {logits.min():.1f} to {logits.max():.1f}, masks {on.min():.2f} to {on.max():.2f} of the frame"
    row(
        model,
        reference,
        what,
        f"logits {worst:.1e}, predicted IoU {scores:.1e}, mask IoU {same:.5f} ({spread})",
    )
    if labels == CORNERS:
        best = quality.argmax(1)
        chosen = masks_of_boxes(network, embedding, BOXES)
        picked = [iou(chosen.mask[i], logits[i, best[i]] > 0) for i in range(len(best))]
        row(model, reference, f"{what}, the best", f"mask IoU {min(picked):.5f}")


def opened(contract: Path) -> Network:
    return Network(load_contract(contract.parent), "cpu")


def hugging_face_sam(folder: Path) -> None:
    import torch
    from transformers import SamConfig, SamModel
    from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil
    from transformers.models.sam.processing_sam import SamProcessor

    side = 256
    vision = {"hidden_size": 32, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
              "image_size": side, "patch_size": 16, "window_size": 7, "global_attn_indexes": [1], "mlp_dim": 64,
              "num_pos_feats": 16}  # fmt: skip
    prompt = {"hidden_size": 32, "image_size": side, "image_embedding_size": 16, "patch_size": 16}
    decoder = {"hidden_size": 32, "mlp_dim": 64, "num_attention_heads": 2, "iou_head_hidden_dim": 32}
    config = SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    torch.manual_seed(0)
    model = shaken(SamModel(config))
    model.save_pretrained(folder / "source")
    network = opened(export_sam(folder / "source", folder / "graphs"))
    size, pad = {"longest_edge": side}, {"height": side, "width": side}
    processor = SamProcessor(SamImageProcessorPil(size=size, pad_size=pad))
    _, picture = frame()
    for what, prompts, asked in (
        ("3 boxes", CUT, {"input_boxes": [CUT.tolist()]}),
        ("2 points", POINTS, {"input_points": [POINTS[:, None].tolist()]}),
    ):
        given = processor(picture, return_tensors="pt", **asked)
        sizes = given.pop("original_sizes"), given.pop("reshaped_input_sizes")
        with torch.no_grad():
            out = model(
                **{
                    name: value.float() if value.dtype == torch.float64 else value
                    for name, value in given.items()
                }
            )
        full = processor.image_processor.post_process_masks(out.pred_masks, *sizes, binarize=False)[0]
        compare(
            "SAM",
            "transformers 5.24, PIL processor and model",
            what,
            network,
            prompts,
            (full, out.iou_scores[0]),
        )


def hugging_face_sam2(folder: Path) -> None:
    import torch
    from torchvision.transforms import Compose, Normalize, Resize, ToTensor
    from transformers import Sam2Config, Sam2ImageProcessor, Sam2Model, Sam2Processor

    side = 256
    hiera = {"hidden_size": 16, "num_attention_heads": 1, "image_size": [side, side], "blocks_per_stage": [1, 1, 2, 1],
             "embed_dim_per_stage": [16, 32, 64, 128], "num_attention_heads_per_stage": [1, 2, 4, 8],
             "global_attention_blocks": [3], "model_type": "sam2_hiera_det_model"}  # fmt: skip
    vision = {"backbone_config": hiera, "backbone_channel_list": [128, 64, 32, 16], "fpn_hidden_size": 32,
              "backbone_feature_sizes": [[64, 64], [32, 32], [16, 16]]}  # fmt: skip
    prompt = {"hidden_size": 32, "image_size": side, "patch_size": 16}
    decoder = {"hidden_size": 32, "mlp_dim": 64, "num_attention_heads": 2, "iou_head_hidden_dim": 32}
    config = Sam2Config(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    torch.manual_seed(0)
    model = shaken(Sam2Model(config))
    model.save_pretrained(folder / "source")
    network = opened(export_sam(folder / "source", folder / "graphs"))
    transforms = Compose(
        [ToTensor(), Resize((side, side)), Normalize((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))]
    )
    processor = Sam2Processor(Sam2ImageProcessor(size={"height": side, "width": side}), target_size=side)
    _, picture = frame()
    for what, prompts, asked in (
        ("3 boxes", CUT, {"input_boxes": [CUT.tolist()]}),
        ("2 points", POINTS, {"input_points": [POINTS[:, None].tolist()], "input_labels": [[[1], [1]]]}),
    ):
        given = processor(images=picture, return_tensors="pt", **asked)
        sizes = given.pop("original_sizes")
        for reference in (
            "transformers 5.24, processor and model",
            "transformers 5.24, the authors' picture",
        ):
            with torch.no_grad():
                out = model(**given, multimask_output=True)
            full = processor.post_process_masks(out.pred_masks, sizes, binarize=False)[0]
            compare("SAM 2.1", reference, what, network, prompts, (full, out.iou_scores[0]))
            # their code shrinks numbers from 0 to 1, transformers bytes: a level of 255 here and there
            given["pixel_values"] = transforms(picture)[None]


def predictor(name: str, reference: str, theirs: Any, network: Network) -> None:
    """A ``SamPredictor``, box by box; and SAM-Track's second pass, which gives the best logits back."""
    bgr, _ = frame()
    theirs.set_image(np.ascontiguousarray(bgr[..., ::-1]))
    answers = [theirs.predict(box=box, multimask_output=True, return_logits=True) for box in CUT]
    logits, quality, low = (np.stack(part) for part in zip(*answers, strict=True))
    compare(name, reference, "3 boxes", network, CUT, (logits, quality))
    dots = [
        theirs.predict(dot[None], np.ones(1), multimask_output=True, return_logits=True)[:2] for dot in POINTS
    ]
    compare(
        name, reference, "2 points", network, POINTS, [np.stack(part) for part in zip(*dots, strict=True)]
    )
    again = [
        theirs.predict(
            box=box, mask_input=before[score.argmax()][None], multimask_output=True, return_logits=True
        )
        for box, before, score in zip(CUT, low, quality, strict=True)
    ]
    tables = {**network.contract.tables, "masks": {**network.contract.tables["masks"], "passes": 2}}
    twice = Network(network.contract.model_copy(update={"tables": tables}), "cpu")
    second = [np.stack(part) for part in list(zip(*again, strict=True))[:2]]
    compare(name, reference, "3 boxes, two passes", twice, CUT, second)


def meta_sam(folder: Path) -> None:
    import torch
    from segment_anything import SamPredictor
    from segment_anything.modeling import ImageEncoderViT, MaskDecoder, PromptEncoder, Sam, TwoWayTransformer

    torch.manual_seed(0)
    side, length = 256, 64
    encoder = ImageEncoderViT(
        img_size=side, embed_dim=64, depth=2, num_heads=2, out_chans=length, use_rel_pos=True, window_size=7,
        global_attn_indexes=(1,),
    )  # fmt: skip
    grid = (side // 16, side // 16)
    prompts = PromptEncoder(
        embed_dim=length, image_embedding_size=grid, input_image_size=(side, side), mask_in_chans=16
    )
    transformer = TwoWayTransformer(depth=2, embedding_dim=length, mlp_dim=128, num_heads=4)
    decoder = MaskDecoder(transformer_dim=length, transformer=transformer, iou_head_hidden_dim=64)
    model = shaken(Sam(encoder, prompts, decoder))
    network = opened(export_meta_sam(model, folder / "graphs", "sam-tiny"))
    with torch.no_grad():
        predictor("SAM", "segment-anything 1.0, SamPredictor", SamPredictor(model), network)


def mobile_sam(folder: Path, clone: Path) -> None:
    """At its real size: the authors' class has no other."""
    import torch

    sys.path.insert(0, str(clone))
    from mobile_sam import SamPredictor, sam_model_registry

    torch.manual_seed(0)
    model = shaken(sam_model_registry["vit_t"](), scale=0.3)
    folder.mkdir()
    torch.save(model.state_dict(), folder / "mobile_sam.pt")
    network = opened(export_sam(folder / "mobile_sam.pt", folder / "graphs"))
    with torch.no_grad():
        predictor("MobileSAM", "the authors' code, SamPredictor", SamPredictor(model), network)


def efficient_sam(folder: Path, clone: Path) -> None:
    """The authors' graph of one piece, with any size of frame and any number of points."""
    import torch

    sys.path.insert(0, str(clone))
    import onnx_models
    from efficient_sam.efficient_sam import build_efficient_sam

    from zsmoseg.networks.export.common import export_graph, write_contract

    torch.manual_seed(0)
    model = shaken(build_efficient_sam(192, 3), scale=0.3)
    bgr, _ = frame()
    picture = torch.from_numpy(np.ascontiguousarray(bgr[..., ::-1])).permute(2, 0, 1)[None] / 255
    image, points = torch.rand(1, 3, 300, 400), torch.rand(1, 2, 2, 2) * 300
    labels = torch.tensor([[[2.0, 3.0], [2.0, 3.0]]])
    free = {1: "prompts", 2: "points"}
    axes = {
        "batched_images": {2: "height", 3: "width"},
        "batched_point_coords": free,
        "batched_point_labels": free,
    }
    names = ["output_masks", "iou_predictions", "low_res_masks"]
    wrapped = onnx_models.OnnxEfficientSam(model)
    export_graph(wrapped, [image, points, labels], folder / "esam.onnx", list(axes), names, axes)
    roles = {"image": "batched_images", "points": "batched_point_coords", "labels": "batched_point_labels"}
    outputs = {"logits": "output_masks", "quality": "iou_predictions"}
    content = {
        "name": "efficient-sam",
        "task": "box-masks",
        "graph": {"main": {"file": "esam.onnx", "inputs": roles, "outputs": outputs}},
        "input": {"colour_order": "RGB", "scale": 1 / 255, "resize": {"rule": "none"}},
        "masks": {"style": "efficient-sam", "boxes_per_call": 2, "pad_point": False},
    }
    network = opened(write_contract(folder, content))
    for what, prompts, label in (("3 boxes", CUT, [2.0, 3.0]), ("2 points", POINTS, [1.0])):
        asked = torch.from_numpy(prompts.reshape(1, len(prompts), -1, 2))
        with torch.no_grad():
            out = wrapped(picture, asked, torch.tensor([label] * len(prompts))[None])
        compare("EfficientSAM", "the authors' code", what, network, prompts, (out[0][0], out[1][0]))


def main(clones: list[Path]) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hugging_face_sam(folder / "hf")
        hugging_face_sam2(folder / "hf2")
        meta_sam(folder / "meta")
        for clone, run in zip(clones, (mobile_sam, efficient_sam), strict=False):
            run(folder / run.__name__, clone)


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
