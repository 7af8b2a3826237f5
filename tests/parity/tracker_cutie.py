"""Cutie: our adapter with exported graphs, against the engine of the authors' code, on frames of DAVIS.

By hand, where torch, omegaconf and the authors' code are (a checkout of github.com/hkchengrex/Cutie):

    PYTHONPATH=CHECKOUT:. python tests/parity/tracker_cutie.py DAVIS/JPEGImages/480p/dog

Random weights; the seed masks are squares on a grid. Prints a row a case: model | reference | what | error.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cutie.inference.inference_core import InferenceCore
from tracker_frames import SIZES, frames_of, seed
from omegaconf import OmegaConf

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.cutie import cutie, write_cutie
from zsmoseg.networks.session import Network
from zsmoseg.tracking.by_cutie import Cutie, CutieTracker

FRAMES = 8
EVERY, KEPT = 2, 3


def tensor_of(frame: np.ndarray) -> torch.Tensor:
    """(3, h, w) red green blue, 0 to 1."""
    return torch.from_numpy(np.ascontiguousarray(frame[..., ::-1])).permute(2, 0, 1).float() / 255


def reference(network: Any, frames: list[np.ndarray], label: np.ndarray, count: int) -> list[np.ndarray]:
    """(1 + objects, h, w) probabilities of every frame after the first."""
    config = OmegaConf.create({
        "model": network.cfg.model, "mem_every": EVERY, "stagger_updates": 5, "chunk_size": -1, "save_aux": False,
        "max_internal_size": -1, "flip_aug": False, "top_k": 30, "use_long_term": False, "max_mem_frames": KEPT,
        "long_term": {"count_usage": True},
    })  # fmt: skip
    engine, found = InferenceCore(network, config), []
    for t, frame in enumerate(frames):
        image = tensor_of(frame)
        if t == 0:
            engine.step(image, torch.from_numpy(label.astype(np.int64)), list(range(1, count + 1)))
        else:
            found.append(engine.step(image).numpy().copy())
    return found


def spread(network: Any, frame: np.ndarray) -> None:
    """Random weights see next to nothing: normalise as training does, so that labels differ and errors are seen."""
    backbones = (network.pixel_encoder, network.mask_encoder)
    norms = [m for backbone in backbones for m in backbone.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    for norm in norms:
        norm.momentum, norm.training = 1.0, True
    generator = torch.Generator().manual_seed(1)
    image = tensor_of(frame[:240, :416])[None]
    features, projected = network.encode_image(image)
    mask = (torch.rand(1, 2, 240, 416, generator=generator) > 0.6).float()
    network.encode_mask(image, projected, torch.zeros(1, 2, 256, 15, 26), mask)
    for norm in norms:
        norm.training = False
    key, shrinkage, _ = network.transform_key(features[0])
    network.key_proj.key_proj.weight.data /= key.std()  # its softmax has no guard: far keys would be 0 / 0
    network.key_proj.d_proj.weight.data /= shrinkage.mean().sqrt()
    network.mask_decoder.pred.weight.data *= 5


def main() -> None:
    """Two sizes, one, three and twelve objects."""
    warnings.simplefilter("ignore")
    torch.manual_seed(0)
    torch.set_num_threads(2)
    with tempfile.TemporaryDirectory() as folder, torch.no_grad():
        network = cutie()
        spread(network, frames_of(Path(sys.argv[1]), SIZES[0], 1)[0])
        write_cutie(network, Path(folder), "cutie")
        for size in SIZES:
            for count in (3, 12):
                frames, label = frames_of(Path(sys.argv[1]), size, FRAMES), seed(size, count)
                wanted = reference(network, frames, label, count)
                tracker = CutieTracker(Network(load_contract(folder), "cpu", 2))
                tracker.rules = Cutie(style="cutie", every=EVERY, frames=KEPT)
                tracker.start(frames[0], label)
                got = [tracker.probability(frame) for frame in frames[1:]]
                error = max(np.abs(a - b).max() for a, b in zip(got, wanted, strict=True))
                same = min((a.argmax(0) == b.argmax(0)).mean() for a, b in zip(got, wanted, strict=True))
                kinds = len(np.unique(np.stack([b.argmax(0) for b in wanted])))
                print(
                    f"cutie | hkchengrex/Cutie | {count} objects, {size[1]}x{size[0]}, {FRAMES} frames, memory every "
                    f"{EVERY}, {KEPT} kept, {kinds} labels seen | probabilities {error:.1e}, labels {100 * same:.3f} %",
                    flush=True,
                )


if __name__ == "__main__":
    main()
