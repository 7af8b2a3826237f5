"""Tiny synthetic videos for benchmarks of everything but the science."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

SIZE = (48, 64)
"""Height and width in pixels."""


def tiny_videos(root: Path, count: int, frames: int = 4) -> list[Path]:
    """Folders of PNG files: a texture that drifts, and before it a square that moves otherwise; all different."""
    rng = np.random.default_rng(0)
    found = []
    for video in range(count):
        folder = root / f"v{video:05d}"
        folder.mkdir(parents=True)
        texture = cv2.GaussianBlur(rng.integers(0, 256, (*SIZE, 3), np.uint8), (0, 0), 2)
        for frame in range(frames):
            image = np.roll(texture, frame, 1)
            image[10:22, 8 + 2 * frame : 22 + 2 * frame] = 255 - image[10:22, 8 + 2 * frame : 22 + 2 * frame]
            cv2.imwrite(str(folder / f"{frame:05d}.png"), image)
        found.append(folder)
    return found
