"""What J of the embedded default's proposals changes by when a setting or constant is halved and doubled.

    python benchmarks/embedded_sensitivity.py DAVIS CACHE [NAME]...

DAVIS holds JPEGImages/480p and Annotations/480p. J is the mean over every second frame, before the decision: of the
ten sequences of the findings, and of the two hard ones, which no constant was tuned on. Without NAME all are tried:
a setting that changes neither by 0.3 is no setting (it is a constant beside the function that uses it).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from embedded_scores import Clip, Parameters, cues, truth_of

from zsmoseg.proposals.embedded import objects, upsampling
from zsmoseg.settings import defaults, resolve

HARD = ("kite-surf", "paragliding-launch")
STEP = 2
"""Frames from one that is scored to the next."""
MOST = {
    "top": 1.0,
    "clean_top": 1.0,
    "clean_from": 1.0,
    "clean_full": 1.0,
    "clean_half": 1.0,
    "unclean_full": 1.0,
}
"""Shares end at 1."""
LEAST = {"pitch": 4.0}
"""Below it there are more superpixels than their numbers can tell apart."""
CUES = {"pitch", "compactness", "passes", "link_least"}
"""What is before the objects."""
T = TypeVar("T")


def values(parameters: Any) -> Iterator[tuple[str, float]]:
    """Name and value of every number in nested groups of parameters."""
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        if is_dataclass(value):
            yield from values(value)
        elif isinstance(value, int | float):
            yield field.name, value


def changed(parameters: T, changes: Mapping[str, float]) -> T:
    """The same with other values by name, wherever in the groups they stand."""
    found: dict[str, Any] = {}
    for field in fields(parameters):  # type: ignore[arg-type]
        value = getattr(parameters, field.name)
        found[field.name] = changed(value, changes) if is_dataclass(value) else changes.get(field.name, value)
    return replace(parameters, **found)  # type: ignore[type-var]


def j_of(clip: Clip, truth: np.ndarray, p: Parameters) -> float:
    """J over every ``STEP``-th frame without the first and last, percent."""
    found = list(
        objects.find_objects(clip.features.part, (0, len(clip.frames)), clip.segments.shape[1:], p.objects)
    )
    out = []
    for t in range(1, len(found) - 1, STEP):
        mask = upsampling.paint(clip.frames[t], clip.segments[t], found[t][1], clip.shape, p.edges) > 0
        union = (mask | truth[t]).sum()
        out.append((mask & truth[t]).sum() / union if union else 1.0)
    return 100 * float(np.mean(out))


def main() -> None:
    """Print the table."""
    davis, cache, *wanted = sys.argv[1:]
    cv2.setNumThreads(1)
    images, start = Path(davis) / "JPEGImages/480p", Parameters.of(resolve())
    names = sorted(path.name for path in images.iterdir())
    truths = {name: truth_of(Path(davis) / "Annotations/480p" / name) for name in names}
    clips = {name: cues(images / name, start, Path(cache)) for name in names}
    own = {
        name.split(".")[1] for name in defaults() if name.split(".")[0] in ("segments", "objects", "labels")
    }

    def means(p: Parameters, fresh: bool) -> tuple[float, float]:
        js = {n: j_of(cues(images / n, p) if fresh else clips[n], truths[n], p) for n in names}
        ten, hard = ([j for n, j in js.items() if (n in HARD) == side] for side in (False, True))
        return float(np.mean(ten)), float(np.mean(hard)) if hard else float("nan")

    ten, hard = means(start, False)
    print(f"{'':16} {'':8} {'ten':>7} {'two':>7}\n{'as it is':16} {'':8} {ten:7.2f} {hard:7.2f}", flush=True)
    groups = (start.superpixels, start.links, start.objects, start.edges)
    for name, value in [pair for group in groups for pair in values(group)]:
        if wanted and name not in wanted:
            continue
        for factor in (0.5, 2):
            other = type(value)(np.clip(value * factor, LEAST.get(name, 0), MOST.get(name, np.inf)))
            if other != value:
                a, b = means(changed(start, {name: other}), name in CUES)
                word = "setting" if name in own else "constant"
                print(f"{name:16} {other:8.5g} {a - ten:+7.2f} {b - hard:+7.2f}  {word}", flush=True)


if __name__ == "__main__":
    main()
