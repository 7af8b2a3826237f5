"""Depth of a network for videos of frames, as files that ``zsmoseg import --depth`` takes.

    python benchmarks/network_depth.py MODEL_FOLDER DAVIS/JPEGImages/480p OUT [SHORT_SIDE]
    zsmoseg import DAVIS/JPEGImages/480p --depth OUT --depth-is inverse-depth --store STORE

MODEL_FOLDER holds one .onnx file and ``contract.toml``: input tensor, resize rule, output tensor. OUT gets a folder a
video with one ``.npy`` (float16) a frame.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnxruntime


def network_input(frame: np.ndarray, contract: dict[str, Any], short: int) -> np.ndarray:
    """(1, 3, H, W) RGB as the contract says: the short side at ``short``, sides rounded to a multiple."""
    rule = contract["input"]["resize"]
    height, width = frame.shape[:2]
    scale, multiple = short / min(height, width), rule["multiple_of"]
    size = [max(short, multiple * round(n * scale / multiple)) for n in (width, height)]
    image = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB).astype(np.float32) * contract["input"]["scale"]
    image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
    mean, std = (np.array(contract["input"][name], np.float32) for name in ("mean", "std"))
    return ((image - mean) / std).astype(np.float32).transpose(2, 0, 1)[None]


def main() -> None:
    """Run the network over every frame of every video."""
    model, frames, out = map(Path, sys.argv[1:4])
    contract = tomllib.loads((model / "contract.toml").read_text())
    short = int(sys.argv[4]) if len(sys.argv) > 4 else contract["input"]["resize"]["short_side"]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(model / contract["file"], options)
    for video in sorted(p for p in frames.iterdir() if p.is_dir()):
        (out / video.name).mkdir(parents=True, exist_ok=True)
        for file in sorted(video.iterdir()):
            tensor = network_input(cv2.imread(str(file)), contract, short)
            found = session.run([contract["output"]["tensor"]], {contract["input"]["tensor"]: tensor})[0]
            np.save(out / video.name / f"{file.stem}.npy", found[0, 0].astype(np.float16))
        print(video.name, flush=True)


if __name__ == "__main__":
    main()
