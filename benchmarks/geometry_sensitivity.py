"""Every constant of the geometry, halved and doubled: what static scenes and movers it costs.

    python benchmarks/geometry_sensitivity.py DAVIS KT3DMOSEG OUT

Static: the background of seven real sequences (``background_crops.py``) and twenty rendered scenes (``parallax.py``), right where
nothing moves. Movers: the same rendered scenes with one mover, right where it is found; and the labelled movers of KT3DMoSeg, hulls of their points as
proposals, right where half of the points move. Constants that are a part of one are halved and doubled in what they leave out.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import background_crops
import cv2
import numpy as np
import parallax
from PIL import Image

from zsmoseg.grouping import geometry
from zsmoseg.painting.palette import encode_png
from zsmoseg.settings import defaults, resolve
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.stages.motion import tracked

LIMITS = ("affinity.error", "affinity.parallax")
CONSTANTS: dict[str, tuple[float, float]] = {
    "FOOT": (1.375, 2.5),
    "NEAREST": (1.5, 6.0),
    "CLOSER": (0.3, 1.0),
    "BESIDE": (2.5, 7.0),
    "OVER": (0.01, 0.04),
    "UNDER": (0.03, 0.12),
    "WIDE": (1.0, 4.0),
    "NARROW": (10.0, 40.0),
    "FRONT": (0.95, 0.8),
    "PRECISION": (0.05, 0.2),
    "SPACING": (4, 16),
    "EVERY": (1, 4),
    "LEAST_WORLD": (20, 80),
    "LOWEST": (0.15, 0.6),
    "BELOW": (0.06, 0.24),
    "ASIDE": (2.0, 8.0),
    "LEAST_BELOW": (2, 8),
}


def hulls(points: Path, frames: Path, out: Path) -> None:
    """Proposals of one clip: in every frame the convex hull of the points of each mover."""
    given = np.load(points)
    out.mkdir(parents=True, exist_ok=True)
    for t, image in enumerate(sorted(frames.glob("*.jpg"))):
        mask = np.zeros(Image.open(image).size[::-1], np.uint8)
        for n in np.unique(given["label"][given["label"] > 1]):
            mine = given["points"][(given["label"] == n) & given["visible"][:, t], t]
            if len(mine) > 2:
                cv2.fillConvexPoly(mask, cv2.convexHull(mine.astype(np.int32)), int(n))
        (out / f"{image.stem}.png").write_bytes(encode_png(mask))


def moving_points(points: Path, masks: Path) -> int:
    """Movers of one clip of which half of the points move."""
    given, right = np.load(points), 0
    moving = [np.asarray(Image.open(file)) > 0 for file in sorted(masks.iterdir())]
    for n in np.unique(given["label"][given["label"] > 1]):
        mine = given["label"] == n
        hits = [
            mask[tuple(given["points"][mine & given["visible"][:, t], t].astype(int).T[::-1])]
            for t, mask in enumerate(moving)
        ]
        right += np.concatenate(hits).mean() >= 0.5
    return int(right)


def compute(sources: list[Path], out: Path, name: str, again: bool, values: Mapping[str, Any]) -> Path:
    """Run; ``again``: the affinity and all behind it anew, as constants are in no key."""
    chosen = resolve(overrides={"overlay.write": False, **values})
    begin = "affinity" if again else None
    request = Request(
        list(map(str, sources)), out / "out" / name, out / "store", chosen, "serial", start_from=begin
    )
    report = run(request)
    assert not report.failures, report.failures
    return out / "out" / name


def put(name: str, value: Any) -> None:
    """Give a constant another value, wherever it is read."""
    for module in (geometry, tracked):
        if hasattr(module, name):
            setattr(module, name, value)


def row(kitti: Path, out: Path, again: bool, values: Mapping[str, Any]) -> str:
    """One line of the table."""
    crops = [out / "crops" / name for name in background_crops.STATIC]
    made = {path.name: path for path in sorted((out / "clips").iterdir())}
    done = compute([*crops, *made.values()], out, "found", again, values)
    told = {p.parent.name: json.loads(p.read_text()) for p in done.glob("*/summary.json")}
    still = {name: one["moving_pixels_percent"] == 0 for name, one in told.items()}
    found = 0
    for name in (name for name in made if name.endswith("1")):
        truth = np.stack([np.asarray(Image.open(p)) for p in sorted((out / "truth" / name).iterdir())]) > 0
        covered, precise = parallax.shares(done / name / "masks", truth)
        found += covered >= 0.5 and precise >= 0.5
    clips = sorted((kitti / "frames").iterdir())
    given = compute(clips, out, "given", again, {**values, "proposals.path": str(out / "hulls")})
    driving = sum(moving_points(kitti / f"{clip.name}.npz", given / clip.name / "masks") for clip in clips)
    crops_right, static_right = (
        sum(still[n] for n in names)
        for names in ([p.name for p in crops], [n for n in made if n.endswith("0")])
    )
    wrong = [name for name, right in still.items() if not right and not name.endswith("1")]
    print(values, "not empty:", *sorted(wrong), file=sys.stderr, flush=True)
    return f"{crops_right} / {static_right} / {found} / {driving}"


def main() -> None:
    """Print the table."""
    davis, kitti, out = map(Path, sys.argv[1:4])
    for name in background_crops.STATIC:
        background_crops.crop(davis, name, out / "crops")
    for seed in range(parallax.SCENES):
        for movers in (0, 1):
            scene, name = parallax.scene_of(seed, movers), f"{seed:04d}-{movers}"
            parallax.write(out, name, scene)
            (out / "truth" / name).mkdir(parents=True, exist_ok=True)
            for t, truth in enumerate(scene.truth > 0):
                (out / "truth" / name / f"{t:05d}.png").write_bytes(encode_png(truth.astype(np.uint8)))
    for clip in sorted((kitti / "frames").iterdir()):
        hulls(kitti / f"{clip.name}.npz", clip, out / "hulls" / clip.name)
    print("crops of 7 / rendered static of 20 / rendered movers of 20 / movers of KT3DMoSeg\n")
    print(
        "| constant | default | half, double | half | double |\n| --- | --- | --- | --- | --- |", flush=True
    )
    without = {"affinity.geometry": False}
    print(f"| without it | | | {row(kitti, out, False, without)} | |", flush=True)
    print(f"| as it is | | | {row(kitti, out, False, {})} | |", flush=True)
    for name, value in ((n, defaults()[n]) for n in LIMITS):
        found = [row(kitti, out, False, {name: other}) for other in (value / 2, value * 2)]
        print(f"| `{name}` | {value:g} | {value / 2:g}, {value * 2:g} | {' | '.join(found)} |", flush=True)
    for name, others in CONSTANTS.items():
        value, found = getattr(geometry, name), []
        for other in others:
            put(name, other)
            found.append(row(kitti, out, True, {}))
        put(name, value)
        print(f"| `{name}` | {value:g} | {others[0]:g}, {others[1]:g} | {' | '.join(found)} |", flush=True)


if __name__ == "__main__":
    main()
