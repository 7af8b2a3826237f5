"""Scores of the embedded default's proposals, in one process and without a store.

usage: python benchmarks/embedded_scores.py --davis DAVIS [--cache DIR] [--set name=value]... [SEQUENCE]...

DAVIS holds JPEGImages/480p and Annotations/480p. Printed per sequence: J (mean intersection over union, first and
last frame left out) and F, precision and recall over all pixels, at full resolution; then ms per frame of each step.
With --cache, flow, superpixels and their features are kept there; their times are then those of reading.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from zsmoseg.flow import dis
from zsmoseg.flow.dis import Dis
from zsmoseg.proposals.embedded import (
    adjacency_loops,
    extraction,
    features,
    features_loops,
    objects,
    superpixels,
    upsampling,
)
from zsmoseg.proposals.embedded.extraction import Links
from zsmoseg.proposals.embedded.features import SuperpixelFeatures
from zsmoseg.proposals.embedded.guided_filter import GuidedFilter
from zsmoseg.proposals.embedded.superpixels import Superpixels
from zsmoseg.settings import Settings, parse_override, resolve

CLOCK: dict[str, float] = defaultdict(float)


@contextmanager
def clock(name: str) -> Iterator[None]:
    """Add the processor time of the block to CLOCK."""
    start = time.process_time()
    yield
    CLOCK[name] += time.process_time() - start


@dataclass(frozen=True)
class Parameters:
    """All settings and constants of the embedded front end."""

    width: int
    flow: Dis
    superpixels: Superpixels
    links: Links
    objects: objects.Objects
    edges: GuidedFilter

    @classmethod
    def of(cls, s: Settings) -> Parameters:
        """Those that settings ask for."""
        slic, chosen = s.segments.parameters(Superpixels), s.objects.parameters(objects.Objects)
        return cls(
            s.frames.width, s.flow.parameters(Dis), slic, Links(), chosen, s.labels.parameters(GuidedFilter)
        )


@dataclass
class Clip:
    """A sequence as far as the objects."""

    frames: np.ndarray
    segments: np.ndarray
    features: SuperpixelFeatures
    shape: tuple[int, int]


def cues(folder: Path, p: Parameters, cache: Path | None = None) -> Clip:
    """Frames, superpixels and their features of a folder of images."""
    files = sorted(folder.glob("*.jpg"))
    with clock("read"):
        images = [cv2.imread(str(file)) for file in files]
    shape = images[0].shape[:2]
    grid = p.width, max(16, round(shape[0] * p.width / shape[1]))
    with clock("resize"):
        frames = np.stack([cv2.resize(image, grid, interpolation=cv2.INTER_AREA) for image in images])
    name = f"{folder.name}-{p.width}-{p.flow}"
    flows = kept(cache, name, "flow", lambda: flow_of(frames, p.flow))
    name += f"-{p.superpixels}"
    seg = kept(
        cache,
        name,
        "superpixels",
        lambda: {"segment": np.stack([superpixels.segment(frame, p.superpixels) for frame in frames])},
    )["segment"]

    def measure() -> dict[str, np.ndarray]:
        forward, backward = (flows[name].astype(np.float32) / 64 for name in ("forward", "backward"))
        states = ["ok"] * len(forward)
        return extraction.measure(frames, seg, forward, backward, states, len(frames), None, p.links).arrays()

    name += f"-{p.links}"
    return Clip(frames, seg, SuperpixelFeatures(**kept(cache, name, "features", measure)), shape)


def flow_of(frames: np.ndarray, parameters: Dis) -> dict[str, np.ndarray]:
    """Flow of all pairs as it is stored: int16, 1/64 px."""
    pairs = [dis.between(a, b, parameters) for a, b in pairwise(frames)]
    forward, backward = (np.rint(np.stack(x) * 64).astype(np.int16) for x in zip(*pairs, strict=True))
    return {"forward": forward, "backward": backward}


def kept(
    cache: Path | None, name: str, label: str, make: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Arrays from the cache, or made and put there."""
    if cache is None:
        with clock(label):
            return make()
    modules = (dis, superpixels, features, extraction, features_loops, adjacency_loops)
    source = "".join(Path(m.__file__).read_text() for m in modules)
    path = cache / f"{sha256((name + source).encode()).hexdigest()[:16]}.npz"
    if not path.exists():
        with clock(label):
            arrays = make()
        cache.mkdir(parents=True, exist_ok=True)
        np.savez(path, **arrays)
        return arrays
    with clock(f"cached {label}"), np.load(path) as file:
        return dict(file)


def masks(clip: Clip, p: Parameters) -> tuple[np.ndarray, list[float], int]:
    """Object of every pixel of all frames, the frames' scores, number of objects."""
    with clock("objects"):
        grid = clip.segments.shape[1:]
        found = list(objects.find_objects(clip.features.part, (0, len(clip.frames)), grid, p.objects))
    with clock("paint"):
        painted = [
            upsampling.paint(frame, segment, ids, clip.shape, p.edges)
            for frame, segment, (_, ids, *_) in zip(clip.frames, clip.segments, found, strict=True)
        ]
    return np.stack(painted), [score for *_, score in found], max(int(ids.max()) for _, ids, *_ in found)


def truth_of(folder: Path) -> np.ndarray:
    """(T, H, W) the annotated foreground."""
    return np.stack(
        [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) > 127 for file in sorted(folder.glob("*.png"))]
    )


def scores(mask: np.ndarray, truth: np.ndarray) -> tuple[float, float, float, float]:
    """J (mean over frames but the first and last), Fu, Pu, Ru (over all pixels), in percent."""
    mask, truth = mask.reshape(len(mask), -1), truth.reshape(len(truth), -1)
    both, any_ = (mask & truth).sum(1).astype(float), (mask | truth).sum(1)
    j = np.where(any_ > 0, both / np.maximum(any_, 1), 1.0)
    p, r = both.sum() / max(mask.sum(), 1), both.sum() / max(truth.sum(), 1)
    return 100 * j[1:-1].mean(), 200 * p * r / max(p + r, 1e-9), 100 * p, 100 * r


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--davis", type=Path, required=True)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="name=value")
    parser.add_argument("sequences", nargs="*")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    p = Parameters.of(resolve(overrides=dict(map(parse_override, options.set))))
    images, truths = (options.davis / name / "480p" for name in ("JPEGImages", "Annotations"))
    rows, frames = [], 0
    for name in options.sequences or sorted(path.name for path in images.iterdir()):
        clip = cues(images / name, p, options.cache)
        mask, score, count = masks(clip, p)
        rows.append(scores(mask > 0, truth_of(truths / name)))
        frames += len(mask)
        print(
            "{:20} J {:5.1f} Fu {:5.1f} Pu {:5.1f} Ru {:5.1f}".format(name, *rows[-1])
            + f"  score {np.mean(score):.2f}  objects {count}",
            flush=True,
        )
    print("{:20} J {:5.1f} Fu {:5.1f} Pu {:5.1f} Ru {:5.1f}".format("mean", *np.mean(rows, 0)))
    print("ms/frame: " + ", ".join(f"{label} {1e3 * spent / frames:.1f}" for label, spent in CLOCK.items()))


if __name__ == "__main__":
    main()
