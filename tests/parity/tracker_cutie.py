"""Cutie: our adapter with exported graphs, against the engine of the authors' code, on frames of DAVIS.

By hand, where torch, omegaconf and the authors' code are (a checkout of github.com/hkchengrex/Cutie):

    PYTHONPATH=CHECKOUT:. python tests/parity/tracker_cutie.py DAVIS/JPEGImages/480p/dog

Random weights; the seed masks are squares on a grid. Prints a row a case: model | reference | what | error.
"""

from __future__ import annotations

import copy
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cutie.inference.inference_core import InferenceCore
from omegaconf import OmegaConf
from tracker_frames import SIZES, frames_of, seed

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.cutie import cutie, write_cutie
from zsmoseg.networks.session import Network
from zsmoseg.tracking.by_cutie import Cutie, CutieTracker

FRAMES = 8
EVERY, KEPT = 2, 3


def tensor_of(frame: np.ndarray) -> torch.Tensor:
    """(3, h, w) red green blue, 0 to 1."""
    return torch.from_numpy(np.ascontiguousarray(frame[..., ::-1])).permute(2, 0, 1).float() / 255


def engine_of(network: Any) -> Any:
    """The authors' engine with the settings of this comparison."""
    config = OmegaConf.create({
        "model": network.cfg.model, "mem_every": EVERY, "stagger_updates": 5, "chunk_size": -1, "save_aux": False,
        "max_internal_size": -1, "flip_aug": False, "top_k": 30, "use_long_term": False, "max_mem_frames": KEPT,
        "long_term": {"count_usage": True},
    })  # fmt: skip
    return InferenceCore(network, config)


def compare(network: Any, model: Path, frames: list[np.ndarray], label: np.ndarray) -> str:
    """Each step from the same state: ours, and the reference's own when its frame changes by a millionth.

    With random weights a step may tip over: which half of the queries looks at a cell is a comparison of numbers that
    are all but equal. So after every step our tracker takes over masks, sensory memory and summaries of the reference;
    what it remembers it encodes by itself.
    """
    generator = torch.Generator().manual_seed(2)
    engine, tracker = engine_of(network), CutieTracker(Network(load_contract(model), "cpu", 2))
    tracker.rules = Cutie(style="cutie", every=EVERY, frames=KEPT)
    engine.step(
        tensor_of(frames[0]), torch.from_numpy(label.astype(np.int64)), list(range(1, int(label.max()) + 1))
    )
    tracker.start(frames[0], label)
    errors, own, same, own_same = [], [], [], []
    for frame in frames[1:]:
        image = tensor_of(frame)
        changed = image * (1 + 1e-6 * torch.randn(image.shape, generator=generator))
        other = copy.deepcopy(engine, {id(network): network}).step(changed).numpy()
        got, wanted = tracker.probability(frame), engine.step(image).numpy()
        for found, error, share in ((got, errors, same), (other, own, own_same)):
            error.append(np.abs(found - wanted).max())
            share.append(100 * (found.argmax(0) == wanted.argmax(0)).mean())
        take_over(tracker, engine, int(label.max()))
    return (
        f"probabilities: half of the steps below {np.median(errors):.0e}, all below {max(errors):.0e} (reference against "
        f"itself {np.median(own):.0e}, {max(own):.0e}); labels {np.median(same):.3f} %, worst step {min(same):.1f} % "
        f"(itself {np.median(own_same):.3f} %, {min(own_same):.1f} %); memory {memory_error(tracker, engine):.0e}"
    )


def take_over(tracker: CutieTracker, engine: Any, count: int) -> None:
    """The state of the reference, but for what is remembered, which is ours."""
    tracker.objects["last_mask"] = engine.last_mask.numpy().copy()
    if tracker.since >= EVERY:
        tracker._remember([])
    for name, kept in (("sensory", engine.memory.sensory), ("object_memory", engine.memory.obj_v)):
        held = np.stack([kept[n].numpy() for n in range(1, count + 1)], 1)
        tracker.objects[name] = held.reshape(tracker.objects[name].shape).copy()


def memory_error(tracker: CutieTracker, engine: Any) -> float:
    """Of what is remembered at the end, in parts of the largest value."""
    values = engine.memory.work_mem.value
    wanted = np.stack([values[n].numpy() for n in sorted(values)], 1)
    frames = [frame["memory_value"] for frame in tracker.together[0].memory()]
    got = np.concatenate([frame.reshape(*frame.shape[:3], -1) for frame in frames], -1)
    return float(np.abs(got - wanted).max() / np.abs(wanted).max())


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
    network.mask_decoder.pred.weight.data *= 2


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
                row = compare(network, Path(folder), frames, label)
                print(
                    f"cutie | hkchengrex/Cutie | {count} objects, {size[1]}x{size[0]}, {FRAMES} frames, memory every "
                    f"{EVERY}, {KEPT} kept | {row}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
