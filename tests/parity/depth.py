"""Our depth of DPT on DINOv2 and of Depth Anything against the networks' own code, on real frames.

    python tests/parity/depth.py [--depth-anything FOLDER]

Needs torch, torchvision and transformers. The networks are tiny and their weights random: what is checked is that each
step is the reference's, not that depth is right. With ``--depth-anything``, a checkout of
DepthAnything/Depth-Anything-V2, input tensors are compared with the authors' own, too.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
import transformers
from dense_rows import SIZES, frame, head, network, row

from zsmoseg.networks.depth import network_depth
from zsmoseg.networks.export.depth_anything import export_depth_anything
from zsmoseg.networks.export.dpt_dinov2 import export_dpt_dinov2
from zsmoseg.networks.image import prepare

IMAGENET = {"image_mean": [0.485, 0.456, 0.406], "image_std": [0.229, 0.224, 0.225]}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--depth-anything", type=Path)
    authors = parser.parse_args().depth_anything
    transformers.logging.set_verbosity_error()
    transformers.logging.disable_progress_bar()
    torch.manual_seed(0)
    head()
    with tempfile.TemporaryDirectory() as folder, torch.no_grad():
        dpt(Path(folder))
        anything(Path(folder), "relative", authors)
        anything(Path(folder), "metric", None)


def backbone() -> Any:
    return transformers.Dinov2Config(
        hidden_size=64, num_hidden_layers=4, num_attention_heads=4, patch_size=14, image_size=518,
        out_features=["stage1", "stage2", "stage3", "stage4"], reshape_hidden_states=False, layerscale_value=1.0,
    )  # fmt: skip


def livelier(model: Any) -> Any:
    """Random weights whose depth differs from place to place and is nowhere cut off at zero."""
    for value in model.parameters():
        if value.ndim > 1:
            torch.nn.init.kaiming_normal_(value) if value.ndim == 4 else value.normal_(
                0, value.shape[-1] ** -0.5
            )
    image = torch.randn(1, 3, 154, 210)
    last = [part for part in model.head.modules() if isinstance(part, torch.nn.Conv2d)][-1]
    kept: list[Any] = []
    hook = last.register_forward_hook(lambda _m, _i, out: kept.append(out))
    model.eval()(image)
    hook.remove()
    last.weight.div_(3 * kept[0].std())
    last.bias.fill_(2 - float((kept[0] / (3 * kept[0].std())).mean()))
    return model


# -------------------------------------------------------------------------- DPT on DINOv2
def dpt(folder: Path) -> None:
    config = transformers.DPTConfig(
        backbone_config=backbone(), is_hybrid=False, neck_hidden_sizes=[16, 32, 64, 64], fusion_hidden_size=256,
        reassemble_factors=[4, 2, 1, 0.5], add_projection=True,
    )  # fmt: skip
    model = livelier(transformers.DPTForDepthEstimation(config))
    model.save_pretrained(folder / "dpt")
    found = network(export_dpt_dinov2(folder / "dpt", folder / "dpt-dinov2"))
    processor = transformers.DPTImageProcessor(do_resize=False, do_pad=True, size_divisor=14, **IMAGENET)
    for size in SIZES:
        image = frame(10, size)
        tensor = processor(images=rgb(image), return_tensors="pt")["pixel_values"]
        ours, where = prepare(image, found.contract.image)
        row("DPT-DINOv2", "transformers", "input", tensor, ours, 1e-6)
        outputs = model(tensor)
        row(
            "DPT-DINOv2",
            "transformers",
            "depth of the network",
            outputs.predicted_depth,
            run(found, ours),
            1e-3,
        )
        got = next(network_depth(found, [image], size))
        # transformers' post-processing leaves the padding in and so stretches it into the frame; as the authors' code
        # it is resized to what the network saw, then the padding is cut off
        top, left = where.top, where.left
        for mode, limit in (("bilinear", 1e-3), ("bicubic", 1.0)):
            full = F.interpolate(outputs.predicted_depth[None], where.canvas, mode=mode)[0, 0]
            depth = full[top : top + size[0], left : left + size[1]].numpy()
            row("DPT-DINOv2", f"torch, {mode}", "1/z of a frame, mean 1", near(1 / depth), got, limit)
        given = processor.post_process_depth_estimation(outputs, [size])[0]["predicted_depth"].numpy()
        row("DPT-DINOv2", "transformers, pad left in", "1/z of a frame, mean 1", near(1 / given), got, 1.0)


# -------------------------------------------------------------------------- Depth Anything
def anything(folder: Path, kind: str, authors: Path | None) -> None:
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone(), neck_hidden_sizes=[16, 32, 64, 64], reassemble_hidden_size=64,
        fusion_hidden_size=32, head_hidden_size=16, depth_estimation_type=kind, max_depth=20 if kind == "metric" else 1,
    )  # fmt: skip
    model = livelier(transformers.DepthAnythingForDepthEstimation(config))
    model.save_pretrained(folder / kind)
    found = network(export_depth_anything(folder / kind, folder / f"depth-anything-{kind}"))
    name = f"Depth Anything ({kind})"
    processor = transformers.DPTImageProcessor(
        size={"height": 518, "width": 518},
        keep_aspect_ratio=True,
        ensure_multiple_of=14,
        resample=3,
        **IMAGENET,
    )
    for size in SIZES:
        image = frame(10, size)
        ours, _ = prepare(image, found.contract.image)
        if authors is not None:
            row(name, "Depth-Anything-V2", "input", by_authors(authors, image), ours, 1e-4)
        tensor = torch.from_numpy(ours)
        outputs = model(tensor)
        row(name, "transformers", "output of the network", outputs.predicted_depth, run(found, ours), 1e-3)
        got = next(network_depth(found, [image], size))
        for aligned, limit in ((True, 1e-3), (False, 1.0)):
            full = F.interpolate(outputs.predicted_depth[None], size, mode="bilinear", align_corners=aligned)[
                0, 0
            ]
            inverse = full.numpy() if kind == "relative" else 1 / full.numpy()
            how = "aligned corners, as the authors" if aligned else "bilinear"
            row(name, f"torch, {how}", "1/z of a frame, mean 1", near(inverse), got, limit)
        whole(name, model, processor, image, got, kind)


def whole(name: str, model: Any, processor: Any, image: np.ndarray, got: np.ndarray, kind: str) -> None:
    """Transformers' own way from frame to frame: it shrinks with antialiasing, enlarges cubically, and fits the side
    that changes less, so only where that is the shorter one do sizes agree with the authors'."""
    inputs = processor(images=rgb(image), return_tensors="pt")
    outputs = model(**inputs)
    given = processor.post_process_depth_estimation(outputs, [image.shape[:2]])[0]["predicted_depth"].numpy()
    size = " x ".join(map(str, inputs["pixel_values"].shape[-2:]))
    inverse = given if kind == "relative" else 1 / given
    row(name, f"transformers, all of it, {size}", "1/z of a frame, mean 1", near(inverse), got, 1.0)


def by_authors(folder: Path, image: np.ndarray) -> np.ndarray:
    """The input tensor by the authors' own transforms."""
    sys.path.insert(0, str(folder))
    from depth_anything_v2.util.transform import NormalizeImage, PrepareForNet, Resize

    sample = {"image": rgb(image) / 255.0}
    resize = Resize(
        518, 518, resize_target=False, keep_aspect_ratio=True, ensure_multiple_of=14, resize_method="lower_bound",
        image_interpolation_method=cv2.INTER_CUBIC,
    )  # fmt: skip
    for step in (resize, NormalizeImage(IMAGENET["image_mean"], IMAGENET["image_std"]), PrepareForNet()):
        sample = step(sample)
    return np.asarray(sample["image"])[None]


# -------------------------------------------------------------------------- both
def rgb(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[..., ::-1])


def run(found: Any, tensor: np.ndarray) -> np.ndarray:
    return np.asarray(found.run("main", {"image": tensor}, ["depth"])["depth"])


def near(inverse: np.ndarray) -> np.ndarray:
    """Of mean 1."""
    return np.asarray(inverse / inverse.mean())


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main()
