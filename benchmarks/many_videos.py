"""Many tiny videos through the serial executor: memory at checkpoints, processor time a video; then a run with nothing to do.

    python benchmarks/many_videos.py OUT [N] [CHECKPOINTS]

OUT is an empty folder; N (300) videos of four frames of 64x48 are drawn there, each other from all others.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from zsmoseg.settings import resolve
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run

FRAMES, HEIGHT, WIDTH, SIDE = 4, 48, 64, 14


def draw(folder: Path, seed: int) -> None:
    """A patch that moves over a still picture."""
    draw = np.random.default_rng(seed)
    picture = np.kron(draw.integers(0, 255, (HEIGHT // 4, WIDTH // 4, 3)), np.ones((4, 4, 1))).astype(
        np.uint8
    )
    folder.mkdir(parents=True)
    for t in range(FRAMES):
        frame = picture.copy()
        frame[16 : 16 + SIDE, 8 + 3 * t : 8 + 3 * t + SIDE] = picture[:SIDE, -SIDE:]
        cv2.imwrite(str(folder / f"{t:05d}.png"), frame)


class Checkpoints(Quiet):
    """Prints memory and processor time every so many videos."""

    def __init__(self, every: int) -> None:
        self.every, self.count = every, 0
        self.process, self.spent = psutil.Process(), time.process_time()

    def finished(self, plan: VideoPlan, summary: dict[str, Any] | None) -> None:
        """One more."""
        self.count += 1
        if self.count % self.every == 0:
            now = time.process_time()
            each, memory = 1e3 * (now - self.spent) / self.every, self.process.memory_info().rss / 1e6
            print(f"{self.count:>6} videos {memory:8.1f} MB {each:7.1f} ms a video", flush=True)
            self.spent = now


def measure(root: Path, count: int, checkpoints: int, title: str) -> None:
    """One run over all videos."""
    begun, wall = time.process_time(), time.perf_counter()
    request = Request([str(root / "data")], root / "out", root / "store", resolve(), "serial")
    print(title)
    report = run(request, Checkpoints(max(1, count // checkpoints)))
    assert len(report.finished) == count, report.failures
    spent, took = time.process_time() - begun, time.perf_counter() - wall
    print(f"{title}: {spent:.1f} s of processor, {1e3 * spent / count:.1f} ms a video, {took:.1f} s wall")


def main() -> None:
    """Print both tables."""
    root = Path(sys.argv[1])
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 300
    checkpoints = int(sys.argv[3]) if len(sys.argv) > 3 else 10
    for seed in range(count):
        draw(root / "data" / f"v{seed:05d}", seed)
    measure(root, count, checkpoints, "computed")
    measure(root, count, checkpoints, "nothing to do")


if __name__ == "__main__":
    main()
