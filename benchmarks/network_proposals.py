"""Masks and depth of real networks, scored: what is decided, the best choice of objects, all of them; and each setting.

    ZSMOSEG_MODELS=FOLDER python benchmarks/network_proposals.py DAVIS STORE [table|sensitivity] [NAME=VALUE ...]

FOLDER holds ``yolov8n-seg`` and ``tcmonodepth-small`` with their contracts. Columns as ``sensitivity.py`` has them, with
milliseconds a frame of each stage; the store keeps what the networks said, so another setting runs none of them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from sensitivity import Bench, bound, score

from zsmoseg.settings import parse_override

NETWORKS: dict[str, Any] = {
    "proposals.source": "network",
    "proposals.model": "yolov8n-seg",
    "depth.source": "network",
    "depth.model": "tcmonodepth-small",
}
TRIED: dict[str, list[Any]] = {
    "selection.score": [0.125, 0.5],
    "selection.overlap": [0.25, 1.0],
    "selection.largest": [0.25, 1.0],
    "linking.overlap": [0.15, 0.6],
    "linking.gap": [1, 6],
    "tracking.carry": [False],
    "looks.span": [2, 5, 10],
}
AT_SPAN_5: dict[str, list[Any]] = {"tracking.handover": [1, 2, 5], "tracking.carry": [False]}
"""What acts only where masks are tracked through several frames."""


def row(bench: Bench, settings: dict[str, Any]) -> str:
    """Fu of the ten and the others, bound and kept of the ten."""
    bench.tables.clear()
    rows, _ = bench.scores(settings)
    tables = [bench.tables[name] for name in bench.names]
    best, kept = (np.array([f(t) for t in tables]) for f in (bound, everything))
    (j, p, r, fu), other = bench.means(rows)
    rest = f"bound {bench.means(best)[0, 3]:5.1f}  kept {bench.means(kept)[0, 3]:5.1f}  others Fu {other[3]:5.1f}"
    return f"J {j:5.1f}  Pu {p:5.1f}  Ru {r:5.1f}  Fu {fu:5.1f}  {rest}"


def everything(table: np.ndarray) -> np.ndarray:
    """All objects kept."""
    return score(table, np.arange(table.shape[1]) > 0)


def main() -> None:
    """Print the row of the defaults, or of every other value too."""
    fixed = {**NETWORKS, **dict(map(parse_override, sys.argv[4:]))}
    bench = Bench(Path(sys.argv[1]), Path(sys.argv[2]), fixed)
    print(f"{'defaults':<26} {row(bench, {})}", flush=True)
    if len(sys.argv) > 3 and sys.argv[3] == "sensitivity":
        for name, values in TRIED.items():
            for value in values:
                print(f"{f'{name} = {value}':<26} {row(bench, {name: value})}", flush=True)
        for name, values in AT_SPAN_5.items():
            for value in values:
                print(
                    f"{f'span 5, {name} = {value}':<26} {row(bench, {'looks.span': 5, name: value})}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
