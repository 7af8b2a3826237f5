"""Two movers in one real video: the object of one sequence pasted into another, drifting.

    python benchmarks/composites.py make DAVIS OUT [STEP]
    zsmoseg run OUT/JPEGImages/480p -o MASKS [--proposals OUT/Annotations/480p]
    python benchmarks/composites.py score MASKS OUT/Annotations/480p

Every sequence of the ten is the host of the one STEP after it, 1 by default. The guest keeps its own frames and its way through the
image, on the side away from the host's object, and drifts by 3 px a frame besides. Truth: 1 = host, 2 = guest.
A composite counts if each of the two has most of its found pixels in a moving group, two different ones, which
cover a third of its pixels or more.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from zsmoseg.painting.palette import encode_png

TEN = [
    "blackswan",
    "bmx-trees",
    "car-shadow",
    "dog",
    "drift-straight",
    "goat",
    "horsejump-high",
    "libby",
    "motocross-jump",
    "scooter-black",
]
FRAMES = 40
DRIFT = 3.0
COVERED = 1 / 3


def read(folder: Path, flag: int) -> np.ndarray:
    """The first frames of a folder."""
    return np.stack([cv2.imread(str(p), flag) for p in sorted(folder.iterdir())[:FRAMES]])


def middle(masks: np.ndarray) -> float:
    """Mean column of what is not zero."""
    return float(np.nonzero(masks)[2].mean())


def paste(davis: Path, host: str, guest: str, out: Path) -> None:
    """Write one composite."""
    frames = read(davis / "JPEGImages/480p" / host, cv2.IMREAD_COLOR)
    below = read(davis / "Annotations/480p" / host, cv2.IMREAD_GRAYSCALE) > 0
    images = read(davis / "JPEGImages/480p" / guest, cv2.IMREAD_COLOR)
    masks = read(davis / "Annotations/480p" / guest, cv2.IMREAD_GRAYSCALE) > 0
    width = frames.shape[2]
    left = middle(below) > width / 2
    offset, drift = (0.25 if left else 0.75) * width - middle(masks), DRIFT if left else -DRIFT
    name = f"{host}+{guest}"
    for folder in ("JPEGImages/480p", "Annotations/480p"):
        (out / folder / name).mkdir(parents=True, exist_ok=True)
    count = min(len(frames), len(images))
    for t in range(count):
        matrix = np.array([[1, 0, round(offset + drift * (t - count / 2))], [0, 1, 0]], np.float64)
        size = (width, frames.shape[1])
        image = cv2.warpAffine(images[t], matrix, size)
        mask = cv2.warpAffine(masks[t].astype(np.uint8), matrix, size, flags=cv2.INTER_NEAREST) > 0
        soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.7)[..., None]
        both = np.rint(frames[t] * (1 - soft) + image * soft).astype(np.uint8)
        cv2.imwrite(
            str(out / "JPEGImages/480p" / name / f"{t:05d}.jpg"), both, [cv2.IMWRITE_JPEG_QUALITY, 95]
        )
        truth = np.where(mask, 2, below[t]).astype(np.uint8)
        (out / "Annotations/480p" / name / f"{t:05d}.png").write_bytes(encode_png(truth))


def overlap(masks: Path, truth: Path) -> np.ndarray:
    """(movers + 1, groups + 1) pixels of the background, then of every mover, by painted group."""
    table = np.zeros((256, 256), np.int64)
    for file in sorted(truth.iterdir()):
        a, b = (np.asarray(Image.open(p)).astype(np.int64) for p in (file, masks / file.name))
        table += np.bincount((a * 256 + b).ravel(), minlength=256**2).reshape(256, 256)
    rows, columns = (int(np.flatnonzero(table.any(axis))[-1]) + 1 for axis in (1, 0))
    return table[:rows, :columns]


def verdict(table: np.ndarray) -> tuple[bool, list[float], list[int]]:
    """Whether all movers move, apart; the share of each that moves; the group that holds most of each."""
    share = [float(row[1:].sum() / row.sum()) for row in table[1:]]
    group = [int(row[1:].argmax()) + 1 if row[1:].any() else 0 for row in table[1:]]
    covered = [row[g] / row.sum() >= COVERED for row, g in zip(table[1:], group, strict=True)]
    return all(covered) and len(set(group)) == len(group) and 0 not in group, share, group


def main() -> None:
    """Make the composites, or score masks of them."""
    if sys.argv[1] == "make":
        step = int(sys.argv[4]) if len(sys.argv) > 4 else 1
        for host, guest in zip(TEN, [*TEN[step:], *TEN[:step]], strict=True):
            paste(Path(sys.argv[2]), host, guest, Path(sys.argv[3]))
        return
    masks, truth = Path(sys.argv[2]), Path(sys.argv[3])
    right = 0
    print(f"{'composite':<32} host moves  guest moves  groups  found")
    for folder in sorted(p for p in truth.iterdir() if (masks / p.name).is_dir()):
        good, share, group = verdict(overlap(masks / folder.name / "masks", folder))
        right += good
        print(
            f"{folder.name:<32} {share[0]:10.0%}  {share[1]:11.0%}  {group}  {'both, apart' if good else '-'}"
        )
    print(f"both movers, in two groups: {right}")


if __name__ == "__main__":
    main()
