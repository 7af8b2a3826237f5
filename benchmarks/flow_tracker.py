"""The tracker along the flow on DAVIS, from true masks of the first frame of spans: what each of its parts adds.

    python benchmarks/flow_tracker.py DAVIS [SEQUENCE ...]

Spans of 5, 10 and 20 frames one after the other; the mean over the frames after the first of the intersection over
union with the truth. Flow by DIS with the default settings, at a working width of 427 px.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from zsmoseg import settings
from zsmoseg.flow.dis import Dis, between
from zsmoseg.tracking.by_flow import Carrying, FlowTracker
from zsmoseg.tracking.carrying import here, look_up, step
from zsmoseg.tracking.protocol import Step

SPANS = (5, 10, 20)
WIDTH = 427
THREE = ["bmx-trees", "libby", "scooter-black"]
NEVER = -9.0
VARIANTS = {
    "carried along the flow": None,
    "+ colours": Carrying(doubt=1.0, ends=NEVER),
    "+ colours, forward-backward check": Carrying(ends=NEVER),
    "+ colours, check, end": Carrying(),
}
"""Parts of the tracker; without any of them masks are looked up frame by frame."""


def steps(davis: Path, name: str) -> tuple[list[Step], list[np.ndarray]]:
    """All frames of a sequence with their flow, and the true masks."""
    frames = [cv2.imread(str(p)) for p in sorted((davis / "JPEGImages/480p" / name).glob("*.jpg"))]
    truth = [cv2.imread(str(p), 0) > 0 for p in sorted((davis / "Annotations/480p" / name).glob("*.png"))]
    height = round(frames[0].shape[0] * WIDTH / frames[0].shape[1])
    small = [cv2.resize(f, (WIDTH, height), interpolation=cv2.INTER_AREA) for f in frames]
    found, parameters = [Step(frames[0])], settings.Flow().parameters(Dis)
    for frame, a, b in zip(frames[1:], small, small[1:], strict=False):
        forward, backward = between(a, b, parameters)
        found.append(Step(frame, backward, forward))
    return found, truth


def tracked(moments: list[Step], label: np.ndarray, carrying: Carrying | None) -> Iterator[np.ndarray]:
    """The label of every frame after the first."""
    if carrying is None:
        for moment in moments[1:]:
            label = look_up(label, step(here(*moment.backward.shape[1:]), moment.backward))
            yield label
        return
    tracker = FlowTracker(moments[1].backward.shape[1:], carrying)
    tracker.start(moments[0].frame, label)
    for moment in moments[1:]:
        yield tracker.step(moment)


def score(moments: list[Step], truth: list[np.ndarray], span: int, carrying: Carrying | None) -> float:
    """Mean IoU, percent."""
    found = []
    for start in range(0, len(moments) - span + 1, span):
        labels = tracked(moments[start : start + span], truth[start].astype(np.uint16), carrying)
        for label, mask in zip(labels, truth[start + 1 : start + span], strict=True):
            either = ((label > 0) | mask).sum()
            found.append(((label > 0) & mask).sum() / either if either else 1.0)
    return 100 * float(np.mean(found))


def main() -> None:
    """A table for all named sequences together, and a row for each."""
    names = sys.argv[2:] or THREE
    table = np.zeros((len(names), len(VARIANTS), len(SPANS)))
    for i, name in enumerate(names):
        moments, truth = steps(Path(sys.argv[1]), name)
        for j, carrying in enumerate(VARIANTS.values()):
            table[i, j] = [score(moments, truth, span, carrying) for span in SPANS]
        for variant, row in zip(VARIANTS, table[i], strict=True):
            print(f"| {name} | {variant} | " + " | ".join(f"{x:.1f}" for x in row) + " |", flush=True)
    for variant, row in zip(VARIANTS, table.mean(0), strict=True):
        print(f"| mean of {len(names)} | {variant} | " + " | ".join(f"{x:.1f}" for x in row) + " |")


if __name__ == "__main__":
    main()
