"""Flow of rendered things that move by 20 px a frame: with the search over all displacements, and its constants halved and doubled.

    python benchmarks/fast_flow.py [SEQUENCE ...]

Twenty pairs of frames of 427 x 240 px, four of each camera, a mover of 2 and one of 21 px a frame. ``right``: px of the faster
whose flow errs by less than 2 px; ``worse``: px of all else whose flow errs by 2 px more than without the search. For folders
of frames of videos: pairs whose flow the search changes.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from zsmoseg.flow import search
from zsmoseg.flow.dis import Dis, between
from zsmoseg.settings import Flow
from zsmoseg.synthetic import CAMERAS, video_scene

PAIRS, WIDTH, SPEEDS = 20, 427, (1.0, 10.0)
CONSTANTS = ("LOST", "BETTER", "ALIKE", "LEAST", "MOST", "SURE", "MARGIN", "MEAN", "CAP", "BORDER", "HALF")


def shrunk(frame: np.ndarray) -> np.ndarray:
    """On the working grid."""
    height = round(frame.shape[0] * WIDTH / frame.shape[1])
    return cv2.resize(frame, (WIDTH, height), interpolation=cv2.INTER_AREA)


def rendered(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Two frames, the flow between them, and the group of each px."""
    scene = video_scene(seed, camera=CAMERAS[seed % len(CAMERAS)], n_frames=2, speeds=list(SPEEDS))
    first, second = (shrunk(picture) for picture in scene.pictures)
    rows, columns = (np.arange(n) * 2 for n in first.shape[:2])
    return first, second, scene.flow[0][:, rows[:, None], columns] / 2, scene.truth[0][rows[:, None], columns]


def row(name: str, reach: int, scenes: list, plain: list, videos: list[list[np.ndarray]]) -> None:
    """Measure and print."""
    parameters = Flow(reach=reach).parameters(Dis)
    right, worse = [], []
    for (first, second, truth, group), before in zip(scenes, plain, strict=True):
        flow = between(first, second, parameters)[0]
        wrong, was = (np.hypot(*(f - truth)) for f in (flow, before))
        fast = group == group.max()
        right.append(np.mean(wrong[fast] < 2))
        worse.append(np.mean(wrong[~fast] > was[~fast] + 2))
    changed = [
        sum(
            any((f != g).any() for f, g in zip(between(a, b, parameters), were, strict=True))
            for a, b, were in v
        )
        for v in videos
    ]
    print(
        f"| {name} | {100 * np.mean(right):.0f} % | {100 * np.mean(worse):.2f} % | {' '.join(map(str, changed))} |",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    off = Flow(reach=0).parameters(Dis)
    scenes = [rendered(seed) for seed in range(PAIRS)]
    plain = [between(first, second, off)[0] for first, second, *_ in scenes]
    videos = []
    for folder in map(Path, sys.argv[1:]):
        frames = [shrunk(cv2.imread(str(path))) for path in sorted(folder.iterdir())]
        videos.append([(a, b, between(a, b, off)) for a, b in pairwise(frames)])
    print(
        f"| | right | worse | pairs changed in {' '.join(Path(p).name for p in sys.argv[1:])} |\n| --- | --- | --- | --- |"
    )
    reach = Flow().reach
    for name, px in (
        ("no search", 0),
        ("as it is", reach),
        ("reach / 2", reach // 2),
        ("reach x 2", 2 * reach),
    ):
        row(name, px, scenes, plain, videos)
    for name in CONSTANTS:
        kept = getattr(search, name)
        for word, factor in (("/ 2", 0.5), ("x 2", 2)):
            value = type(kept)(kept * factor)
            setattr(
                search, name, value | 1 if name == "MEAN" else value
            )  # the square around a cell has a middle
            row(f"{name} {word}", reach, scenes, plain, videos)
        setattr(search, name, kept)


if __name__ == "__main__":
    main()
