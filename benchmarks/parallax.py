"""Static scenes with strong parallax, rendered: nothing is to move; with one true mover, it alone.

    python benchmarks/parallax.py OUT [FIRST [given] [SETTING=VALUE]...]

Twenty scenes, from seed FIRST (0) on: a wall and a ground, and poles, walls and boxes that stand on it 3.5 to 9 units from a
camera whose way is sideways, forward or both. Each once as it is and once with something that moves, 24 frames of 320 x 568.
``given``: the exact labels as proposals. A mover is found if half of its pixels move, and half of what moves is its.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import parse_override, resolve
from zsmoseg.synthetic import Camera, Scene, video_scene
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

WAYS: tuple[Camera, ...] = ("lateral", "forward", "general")
SCENES, FRAMES, SHAPE = 20, 24, (320, 568)


def scene_of(seed: int, movers: int) -> Scene:
    """One scene; the static things are the same with a mover and without."""
    camera = WAYS[seed % len(WAYS)]
    return video_scene(seed, movers, 0, camera, FRAMES, SHAPE, 1.5, exact=False, n_near=5)


def write(out: Path, name: str, scene: Scene) -> None:
    """The frames and the labels."""
    for kind, images in (("clips", scene.pictures), ("labels", scene.labels.astype(np.uint8))):
        (out / kind / name).mkdir(parents=True, exist_ok=True)
        for t, image in enumerate(images):
            coded = encode_png(image) if image.ndim == 2 else cv2.imencode(".png", image)[1].tobytes()
            (out / kind / name / f"{t:05d}.png").write_bytes(coded)


def shares(masks: Path, truth: np.ndarray) -> tuple[float, float]:
    """Part of the mover that moves, part of what moves that is the mover's."""
    moving = np.stack([np.asarray(Image.open(p)) > 0 for p in sorted(masks.iterdir())])
    both = float((moving & truth).sum())
    return both / max(int(truth.sum()), 1), both / max(int(moving.sum()), 1)


def main() -> None:
    """Print the table."""
    out, first, words = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0, sys.argv[3:]
    given = [f"proposals.path={out / 'labels'}"] if "given" in words else []
    words = ["overlay.write=false", *given, *(word for word in words if word != "given")]
    chosen = resolve(overrides=dict(map(parse_override, words)))
    truth = {}
    for seed in range(first, first + SCENES):
        for movers in (0, 1):
            name = f"{seed:04d}-{WAYS[seed % len(WAYS)]}-{movers}"
            scene = scene_of(seed, movers)
            truth[name] = scene.truth > 0
            write(out, name, scene)
    sources = [str(out / "clips" / name) for name in truth]
    run(Request(sources, out / "out", out / "store", chosen, "serial"))
    empty = found = 0
    for name, mover in truth.items():
        told = json.loads((out / "out" / name / "summary.json").read_text())
        moving = told["moving_pixels_percent"]
        covered, precise = shares(out / "out" / name / "masks", mover)
        right = moving == 0 if name.endswith("0") else covered >= 0.5 and precise >= 0.5
        empty, found = empty + (right and name.endswith("0")), found + (right and name.endswith("1"))
        verdicts = [e["geometry"] for e in told["evidence"]]
        print(
            f"{name:<20} {moving:6.2f} % moving, {covered:4.0%} of the mover, {precise:4.0%} of what moves  "
            f"{'' if right else 'WRONG'}  {verdicts.count('obeys')} obey"
        )
    print(f"static, empty: {empty} of {SCENES}; with a mover, found: {found} of {SCENES}")


if __name__ == "__main__":
    main()
