"""Rendered clips of movers of which the fastest is 3 or 10 times faster than the slowest: is each a group of its own?

    python benchmarks/unequal_speeds.py [SLOWEST [FIRST SEED]]

Twenty clips a row, four of each camera: 10 frames of 480 x 854, six bodies that stand still. The slowest mover moves by SLOWEST % of
half the frame's width a frame against what stands still at its depth (0.6 is 1.3 px of the working grid), the third mover
half way in between (geometrically). A clip is right as a composite is (``composites.py``): a third of every mover or more in one
moving group, different ones.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from composites import overlap, verdict

from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import resolve
from zsmoseg.synthetic import CAMERAS, video_scene
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

CLIPS, FRAMES = 20, 10


def write(root: Path, seed: int, movers: int, ratio: float, slowest: float) -> Path:
    """Frames and truth of one clip; its folder of frames."""
    speeds = slowest * np.geomspace(1, ratio, movers)
    scene = video_scene(
        seed, camera=CAMERAS[seed % len(CAMERAS)], n_frames=FRAMES, exact=False, speeds=speeds.tolist()
    )
    frames, truth = (root / kind / f"{movers}-{ratio:g}-{seed:03d}" for kind in ("frames", "truth"))
    frames.mkdir(parents=True)
    truth.mkdir(parents=True)
    for t, (picture, group) in enumerate(zip(scene.pictures, scene.truth, strict=True)):
        cv2.imwrite(str(frames / f"{t:05d}.png"), picture)
        (truth / f"{t:05d}.png").write_bytes(encode_png(group.astype(np.uint8)))
    return frames


def main() -> None:
    """Print the table."""
    slowest = float(sys.argv[1]) if len(sys.argv) > 1 else 0.6
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for movers in (2, 3):
            for ratio in (3.0, 10.0):
                clips = [write(root, seed, movers, ratio, slowest) for seed in range(first, first + CLIPS)]
                run(Request([str(c) for c in clips], root / "out", root / "store", resolve(), "serial"))
                found = [
                    verdict(overlap(root / "out" / c.name / "masks", root / "truth" / c.name)) for c in clips
                ]
                for clip, (good, share, group) in zip(clips, found, strict=True):
                    if not good:
                        moves = ", ".join(f"{s:.0%}" for s in share)
                        print(f"{clip.name}: of the movers move {moves}, most in the groups {group}")
                print(
                    f"{movers} movers, {ratio:g} times: {sum(good for good, *_ in found)} of {CLIPS}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
