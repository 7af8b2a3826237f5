"""Flow residuals, epipolar residuals and both as the affinity of objects: Fu of the groups on DAVIS.

    python benchmarks/object_cues.py DAVIS PROPOSALS [SEQUENCE ...]

PROPOSALS holds a folder of indexed PNG a sequence, ids stable over it. Rule ``spectral``, told two groups or
none, so that nothing but the affinity decides. "Bound": every object on the side where most of its pixels are.
"""

from __future__ import annotations

import sys
import time
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from zsmoseg.flow import between
from zsmoseg.grouping.affinity import accumulate, normalised
from zsmoseg.grouping.arrays import shot_grams
from zsmoseg.grouping.epipolar import epipolar_residuals
from zsmoseg.grouping.fusion import fused
from zsmoseg.grouping.groups import spectral_groups
from zsmoseg.metrics import track_scores
from zsmoseg.motion.models import MODELS
from zsmoseg.motion.residuals import pair_residuals
from zsmoseg.settings import resolve
from zsmoseg.trajectories import follow, look_up

WIDTH, SPACING = 427, 12
SETTINGS = resolve(overrides={"groups.rule": "spectral", "groups.count": 2})
TOLD = SETTINGS.groups
AUTO = resolve(overrides={"groups.rule": "spectral"}).groups
CUES = ("flow", "epipolar", "sum", "co-regularised")
COLUMNS = (*CUES, *(f"{cue}, auto" for cue in CUES), "bound")


def load(folder: Path, flags: int, size: tuple[int, int] | None = None) -> list[np.ndarray]:
    """The images of a folder in order, at ``size``."""
    how = cv2.INTER_NEAREST if flags == cv2.IMREAD_UNCHANGED else cv2.INTER_AREA
    images = [cv2.imread(str(path), flags) for path in sorted(folder.iterdir())]
    return images if size is None else [cv2.resize(image, size, interpolation=how) for image in images]


def palette(folder: Path) -> list[np.ndarray]:
    """Ids of indexed PNG."""
    from PIL import Image

    return [np.array(Image.open(path)) for path in sorted(folder.iterdir())]


def scores(davis: Path, proposals: Path, name: str) -> list[float]:
    """Fu by column."""
    pictures = load(davis / "JPEGImages" / "480p" / name, cv2.IMREAD_COLOR)
    truth = [t > 0 for t in load(davis / "Annotations" / "480p" / name, cv2.IMREAD_GRAYSCALE)]
    objects = palette(proposals / name)
    size = (WIDTH, round(WIDTH * pictures[0].shape[0] / pictures[0].shape[1]))
    frames = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pictures]
    labels = np.stack([cv2.resize(o, size, interpolation=cv2.INTER_NEAREST) for o in objects])
    flow = [between(a, b, SETTINGS.flow) for a, b in pairwise(frames)]
    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count).astype(float)

    grams = shot_grams(labels, np.stack([f for f, _ in flow]), None, SETTINGS)
    model = MODELS["quadratic"]
    by_flow = accumulate(
        ((g.ids, *pair_residuals(g.objects, model)[:2]) for g in grams), count, SETTINGS.affinity
    )
    began = time.perf_counter()
    tracks = follow(flow, size[1], size[0], SPACING)
    on = np.concatenate([look_up(label, tracks.place[tracks.at(t)]) for t, label in enumerate(labels)])
    pairs = ((p.ids, p.residual, p.points) for p in epipolar_residuals(tracks, on))
    by_points = accumulate(pairs, count, SETTINGS.affinity)
    milliseconds = 1000 * (time.perf_counter() - began) / len(frames)

    views = [normalised(*by_flow), normalised(*by_points)]
    affinities = [*views, fused(views), fused(views, 2)]
    groups = [spectral_groups(a, area, s) for s in (TOLD, AUTO) for a in affinities]
    inside = np.bincount(np.concatenate([o[t] for o, t in zip(objects, truth, strict=True)]), minlength=count)
    everything = np.bincount(np.stack(objects).ravel(), minlength=count)
    groups.append((inside > everything / 2).astype(np.int64))
    found = [
        track_scores((t.astype(int), g[o]) for t, o in zip(truth, objects, strict=True)).fu for g in groups
    ]
    alive = len(tracks.frame) / len(frames)
    print(
        f"{name:<20}"
        + "".join(f"{v:>22.1f}" for v in found)
        + f"{alive:>10.0f} tracks {milliseconds:6.1f} ms",
        flush=True,
    )
    return found


def main() -> None:
    """Print the table."""
    davis, proposals = Path(sys.argv[1]), Path(sys.argv[2])
    names = sys.argv[3:] or sorted(path.name for path in proposals.iterdir() if path.is_dir())
    print(f"{'':<20}" + "".join(f"{name:>22}" for name in COLUMNS) + "  a frame")
    found = np.array([scores(davis, proposals, name) for name in names])
    print(f"{'mean':<20}" + "".join(f"{v:>22.1f}" for v in found.mean(0)))


if __name__ == "__main__":
    main()
