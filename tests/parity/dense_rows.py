"""Real frames in two sizes, networks from exports, and the rows of the table that parity of dense networks prints."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.session import Network

SHARED = Path(os.environ.get("ZSMOSEG_SHARED", Path(__file__).parents[3] / "shared" / "data"))
SIZES = ((480, 854), (270, 481))
"""Height and width: as DAVIS has it, and a frame with an odd side."""


def frame(number: int, size: tuple[int, int] = SIZES[0], sequence: str = "goat") -> np.ndarray:
    """(H, W, 3) uint8, blue green red."""
    path = SHARED / "DAVIS" / "JPEGImages" / "480p" / sequence / f"{number:05d}.jpg"
    image = cv2.imread(str(path))
    if image is None:
        raise SystemExit(f"{path}: no such frame; set ZSMOSEG_SHARED to the folder with DAVIS")
    return image if image.shape[:2] == size else cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)


def network(contract: Path) -> Network:
    return Network(load_contract(contract.parent), "cpu", 2)


def head() -> None:
    print("| model | reference | what | frame | max error | mean error | largest value |")
    print("| --- | --- | --- | --- | --- | --- | --- |", flush=True)


def row(model: str, reference: str, what: str, wanted: Any, got: Any, limit: float) -> None:
    """Print a row, and stop where the error is more than ``limit`` of the largest value."""
    a, b = np.asarray(wanted, np.float64), np.asarray(got, np.float64)
    if a.shape != b.shape:
        raise SystemExit(f"{model}, {what}: shape {b.shape}, {reference} has {a.shape}")
    error, most = np.abs(a - b), np.abs(a).max()
    size = " x ".join(map(str, a.shape[-2:]))
    print(
        f"| {model} | {reference} | {what} | {size} | {error.max():.1e} | {error.mean():.1e} | {most:.3g} |",
        flush=True,
    )
    if not error.max() <= limit * most:
        raise SystemExit(f"{model}, {what}: differs from {reference} by more than {limit} of {most}")
