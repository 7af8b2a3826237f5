"""What the scripts of this folder share: a real frame, a row of the table, a tiny network with weights of some size."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
FRAME = ROOT.parent / "shared/data/DAVIS/JPEGImages/480p/dog/00000.jpg"
BOXES = np.float32([[100, 60, 420, 400], [300.5, 20.25, 800, 470.75], [-20, 200, 260, 500]])
"""px of that frame, 854 x 480; the last reaches beyond it."""


def frame() -> tuple[np.ndarray, Any]:
    """The frame (H, W, 3) BGR, and the same as a picture of PIL."""
    from PIL import Image

    bgr = cv2.imread(str(FRAME))
    if bgr is None:
        raise SystemExit(f"{FRAME} is not there: the comparison wants a real frame")
    return bgr, Image.fromarray(bgr[..., ::-1])


def shaken(model: Any, seed: int = 0, scale: float = 1.0) -> Any:
    """A torch module whose weights are not so small, nor its biases so equal, that errors hide."""
    import torch

    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in model.parameters():
            spread = scale / max(parameter[0].numel(), 1) ** 0.5 if parameter.ndim > 1 else 0.1 * scale
            parameter.add_(spread * torch.randn(parameter.shape, generator=generator))
    return model.eval()


def row(model: str, reference: str, what: str, error: str) -> None:
    print(f"| {model} | {reference} | {what} | {error} |", flush=True)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    union = (a | b).sum()
    return float((a & b).sum() / union) if union else 1.0
