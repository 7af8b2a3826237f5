"""The tables of the core on synthetic scenes: exact labels as proposals, number of groups automatic.

python benchmarks/synthetic_table.py [SCENES]          default 100; about four minutes
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np

from zsmoseg.grouping.core import Core, group_arrays
from zsmoseg.grouping.groups import ShotGroups
from zsmoseg.settings import Settings, resolve
from zsmoseg.synthetic import CAMERAS, Scene, flow_scene

SHIFT = {"motion.model": "screw-shift"}
SPECTRAL = {**SHIFT, "groups.rule": "spectral"}


def answer(scene: Scene, settings: Settings) -> ShotGroups:
    """The groups of a scene with its inverse depth."""
    model, core = settings.motion.chosen(True), settings.parameters(Core)
    return group_arrays(scene.labels, scene.pictures, scene.flow, scene.inverse_depth, model, core)[0]


def paper(scene: Scene, ranking: str, share: float) -> dict[str, Any]:
    """The rule of the paper, told the true number of groups."""
    core = dict(resolve("paper-core").flat())
    told = {"groups.count": len(np.unique(scene.group)), "affinity.ranking": ranking, "affinity.share": share}
    return {n: v for n, v in core.items() if n.split(".")[0] in ("affinity", "groups")} | SHIFT | told


def row(title: str, scenes: Iterable[Scene], rules: dict[str, Any]) -> None:
    """Print how many scenes are right, in brackets static / moving only."""
    right = {name: np.zeros(2, int) for name in rules}
    total = 0
    for scene in scenes:
        total += 1
        for name, rule in rules.items():
            settings = resolve(overrides=rule(scene) if callable(rule) else rule)
            right[name] += scene.right(answer(scene, settings).group)
    cells = "  ".join(f"{name} {a:3d} ({b:3d})" for name, (a, b) in right.items())
    print(f"{title:<34} {cells}  of {total}", flush=True)


def states(count: int) -> None:
    """Movers that stop half way: the states but two pairs around the change."""
    right = total = found = movers = 0
    for seed in range(count):
        scene = flow_scene(seed, stop=True, n_pairs=16)
        result = answer(scene, resolve(overrides=SHIFT))
        far = np.abs(np.arange(16) - 7.5) > 1
        for n in np.flatnonzero(scene.group):
            movers += 1
            if result.group[n]:
                found += 1
                right += int((result.moving[:-1, n] == scene.moving[:, n])[far].sum())
                total += int(far.sum())
    print(f"movers that stop: {found} of {movers} found, {right} of {total} states right", flush=True)


def main() -> None:
    """Print all tables."""
    cv2.setNumThreads(1)
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    fifth, half = max(count // 5, 1), max(count // 2, 1)
    rules: dict[str, Any] = {
        "default": SHIFT,
        "spectral": SPECTRAL,
        "paper row": lambda scene: paper(scene, "row", 0.5),
        "paper column": lambda scene: paper(scene, "column", 0.5),
    }
    print(
        "scenes with every object right (static / moving right); the paper's rule is told the number of groups"
    )
    for noise in (0.0, 0.1, 0.3):
        row(f"noise {noise}, screw-shift", (flow_scene(s, noise=noise) for s in range(count)), rules)
    for model in ("screw", "screw-printed", "screw-plane", "quadratic", "affine"):
        scenes = (flow_scene(s) for s in range(count))
        row(f"noise 0.1, {model}", scenes, {"default": {"motion.model": model}})
    for camera in CAMERAS:
        scenes = (flow_scene(s, camera=camera) for s in range(fifth))
        row(f"camera {camera}", scenes, {"default": SHIFT})
    for movers in range(4):
        scenes = (flow_scene(s, n_movers=movers, companions=0.0) for s in range(half))
        row(f"{movers} movers, {movers + 1} groups", scenes, {"default": SHIFT})
    for leak in (3, 6):
        row(f"masks leak {leak} px", (flow_scene(s, leak=leak) for s in range(half)), {"default": SHIFT})
    scenes = (flow_scene(s, depth_noise=0.05) for s in range(half))
    row("inverse depth 5 % wrong", scenes, {"default": SHIFT})
    states(max(count * 3 // 10, 1))


if __name__ == "__main__":
    main()
