"""Still, panned and zoomed photographs: the share of pixels that is called moving should be 0.

    python benchmarks/nothing_moves.py DAVIS/JPEGImages/480p

The first frame of six sequences, 16 frames each: still, a pan of 3 px a frame, a zoom of 1 % a frame with a turn of
0.3 degrees; Gaussian noise of 3 grey levels.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from zsmoseg.settings import resolve
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

SEQUENCES = ("blackswan", "bmx-trees", "car-shadow", "goat", "libby", "scooter-black")
FRAMES = 16


def photograph(image: np.ndarray, kind: str, t: int, noise: np.random.Generator) -> np.ndarray:
    """Frame ``t`` of a camera that sees a photograph."""
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 0.0, 1.25)
    if kind == "pan":
        matrix[:, 2] += (3.0 * (t - FRAMES / 2), 1.0 * (t - FRAMES / 2))
    elif kind == "zoom":
        matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 0.3 * t, 1.1 * 1.01**t)
    moved = cv2.warpAffine(
        image, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )
    return np.clip(moved + noise.normal(0, 3, moved.shape), 0, 255).astype(np.uint8)


def main() -> None:
    """Print the table."""
    clips = []
    with tempfile.TemporaryDirectory() as folder:
        root, noise = Path(folder), np.random.default_rng(0)
        for name in SEQUENCES:
            image = cv2.imread(str(sorted((Path(sys.argv[1]) / name).iterdir())[0]))
            for kind in ("still", "pan", "zoom"):
                clip = root / f"{name}-{kind}"
                clip.mkdir()
                clips.append(clip)
                for t in range(FRAMES):
                    cv2.imwrite(str(clip / f"{t:05d}.png"), photograph(image, kind, t, noise))
        run(Request([str(c) for c in clips], root / "out", root / "store", resolve(), "serial"))
        moving = {}
        for clip in clips:
            summary = json.loads((root / "out" / clip.name / "summary.json").read_text())
            moving[clip.name] = summary["moving_pixels_percent"]
            proposed = (
                100 * sum(e["pixels"] for e in summary["evidence"]) / (FRAMES * np.prod(summary["size"]))
            )
            print(f"{clip.name:<24} {moving[clip.name]:6.2f} % moving, {proposed:6.2f} % proposed")
    print(f"under 0.5 %: {sum(m < 0.5 for m in moving.values())} of {len(moving)}")


if __name__ == "__main__":
    main()
