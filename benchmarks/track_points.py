"""Classification error of track points, best assignment, in percent: each cue and all fused, the number of groups told
(and, in one line, estimated).

    python benchmarks/track_points.py KT3DMOSEG HOPKINS155

Either folder holds one npz a clip: ``points`` (N, T, 2), ``visible`` (N, T), ``label`` (N,). "Cut": spectral clustering
into as many parts as there are groups, as published; "merged": into three times as many, merged by affinity.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from zsmoseg.datasets.point_tracks import read_tracks
from zsmoseg.grouping.fusion import count_groups
from zsmoseg.grouping.points import classify, combined, cue_affinity, parted
from zsmoseg.grouping.twoview import CUES
from zsmoseg.metrics.misclassification import classification_error

COLUMNS = (*CUES, "added", "co-regularised")


def clip_errors(path: Path) -> tuple[dict[bool, list[float]], float, bool]:
    """Errors of all columns, cut and merged; of ``added`` where the number of groups is estimated; whether it is right."""
    points, visible, truth = read_tracks(path)
    affinities = {cue: cue_affinity(points, visible, cue) for cue in CUES}
    groups = len(np.unique(truth))
    out = {}
    for merge in (False, True):
        found = classify(affinities, groups, merge)
        out[merge] = [classification_error(truth, found[name]) for name in COLUMNS]
    total = combined(affinities)
    estimate = count_groups(total)
    return out, classification_error(truth, parted(total, estimate)), estimate == groups


def row(title: str, values: np.ndarray) -> None:
    """Print numbers under the columns."""
    print(f"{title:<34}" + "".join(f"{value:>16.2f}" for value in values), flush=True)


def table(folder: Path, each: bool) -> None:
    """Errors of all clips of a data set, mean and median."""
    began = time.perf_counter()
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        sys.exit(f"{folder}: no .npz clips")
    print(f"\n{folder.name}, {len(paths)} clips\n{'':<34}" + "".join(f"{name:>16}" for name in COLUMNS))
    errors, estimated = [], []
    for path in paths:
        told, *automatic = clip_errors(path)
        errors.append(told)
        estimated.append(automatic)
        if each:
            row(f"{path.stem}, cut", np.array(told[False]))
            row(f"{path.stem}, merged", np.array(told[True]))
    for merge, title in ((False, "cut"), (True, "merged")):
        values = np.array([e[merge] for e in errors])
        row(f"mean, {title}", values.mean(0))
        row(f"median, {title}", np.median(values, axis=0))
    error, right = np.array(estimated, float).T
    print(
        f"number of groups estimated, added: mean {error.mean():.2f}, median {np.median(error):.2f}; "
        f"number right in {int(right.sum())}"
    )
    print(f"{(time.perf_counter() - began) / len(paths):.1f} s a clip")


def main() -> None:
    """Print the tables of both data sets."""
    for folder, each in zip(sys.argv[1:], (True, False), strict=True):
        table(Path(folder), each)


if __name__ == "__main__":
    main()
