"""DeAOT: our adapter with exported graphs, against the engine of the authors' code, on frames of DAVIS.

By hand, where torch and the authors' code are (a checkout of github.com/yoxu515/aot-benchmark):

    PYTHONPATH=CHECKOUT:. python tests/parity/tracker_deaot.py DAVIS/JPEGImages/480p/dog

Random weights; the seed masks are squares on a grid. Prints a row a case: model | reference | what | error.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from dataloaders.video_transforms import MultiRestrictSize, MultiToTensor
from networks.engines import build_engine
from tracker_frames import SIZES, frames_of, seed

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.export.deaot import deaot, write_deaot
from zsmoseg.networks.session import Network
from zsmoseg.tracking.aggregation import softmax
from zsmoseg.tracking.by_deaot import DeaotTracker

FRAMES = 8
GAP = 2


def reference(network: Any, frames: list[np.ndarray], label: np.ndarray, count: int) -> list[np.ndarray]:
    """(1 + objects, h, w) logits of every frame after the first, as the authors' evaluator gets them."""
    engine = build_engine("deaotengine", phase="eval", aot_model=network, gpu_id=0, long_term_mem_gap=GAP)
    engine.eval()
    restrict, tensor, logits = MultiRestrictSize(None, 1040, False, [1], True), MultiToTensor(), []
    for t, frame in enumerate(frames):
        sample = {"current_img": np.array(frame, np.float32)[:, :, [2, 1, 0]], "meta": {}}
        image = tensor(restrict(sample))[0]["current_img"][None].float()
        if t == 0:
            small = F.interpolate(
                torch.from_numpy(label.astype(np.float32))[None, None], image.shape[2:], mode="nearest"
            )
            engine.add_reference_frame(image, small, frame_step=0, obj_nums=[count])
            continue
        engine.match_propogate_one_frame(image)
        found = engine.decode_current_logits(frame.shape[:2])
        logits.append(found[0].numpy().copy())
        hard = torch.softmax(found, 1).argmax(1, keepdim=True).float()
        engine.update_memory(F.interpolate(hard, engine.input_size_2d, mode="nearest"))
    return logits


def compare(folder: Path, model: Path, network: Any, name: str) -> None:
    """A row for each size and number of objects."""
    for size in SIZES:
        for count in (3, 12):
            frames, label = frames_of(folder, size, FRAMES), seed(size, count)
            wanted = reference(network, frames, label, count)
            tracker = DeaotTracker(Network(load_contract(model), "cpu", 2))
            tracker.start(frames[0], label)
            errors, chances, same, kinds, largest = [], [], [], set(), 0.0
            for frame, other in zip(frames[1:], wanted, strict=True):
                got = tracker.logits(frame)
                there = other > -1e9
                errors.append(np.abs(got - other)[there].max())
                chances.append(np.abs(softmax(got) - softmax(other)).max())
                largest = max(largest, np.abs(other[there]).max())
                tracker.label = got.argmax(0).astype(np.uint16)
                tracker.since += 1
                same.append((tracker.label == other.argmax(0)).mean())
                kinds |= set(np.unique(tracker.label).tolist())
            print(
                f"{name} | aot-benchmark | {count} objects, {size[1]}x{size[0]}, {FRAMES} frames, gap {GAP}, "
                f"{len(kinds)} labels seen | logits {max(errors):.1e} of {largest:.1f}, probabilities "
                f"{max(chances):.1e}, labels {100 * min(same):.3f} %",
                flush=True,
            )


def main() -> None:
    """Every named network, ``deaotl`` where none is."""
    torch.manual_seed(0)
    torch.set_num_threads(2)
    for name in sys.argv[2:] or ["deaotl"]:
        network, _ = deaot(name)
        for parameter in network.decoder.conv_out.parameters():
            parameter.data *= 20  # random logits are all but equal: spread them, so that labels differ
        with tempfile.TemporaryDirectory() as folder:
            write_deaot(network, Path(folder), name, GAP)
            with torch.no_grad():
                compare(Path(sys.argv[1]), Path(folder), network, name)


if __name__ == "__main__":
    main()
