"""What our code takes around a network: milliseconds a frame inside ONNX Runtime, and outside of it.

    python benchmarks/network_overhead.py MODELS DAVIS/JPEGImages/480p/goat

MODELS holds ``tcmonodepth-small`` and ``yolov8n-seg``. One thread; the median of the frames, the first left out.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from zsmoseg.networks.contract import load_contract
from zsmoseg.networks.depth import network_depth
from zsmoseg.networks.instance_masks import network_instances
from zsmoseg.networks.session import Network

FRAMES = 30


class Timed:
    """A session that notes how long its calls take."""

    def __init__(self, session: Any) -> None:
        self.session, self.seconds = session, 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.session, name)

    def run(self, *given: Any) -> Any:
        """Run and note."""
        clock = time.perf_counter()
        found = self.session.run(*given)
        self.seconds += time.perf_counter() - clock
        return found


def measure(folder: Path, use: Callable[[Network, Any], Iterator[Any]], frames: list[np.ndarray]) -> str:
    """One row."""
    network = Network(load_contract(folder))
    next(use(network, frames[:1]))
    session = network._sessions["main"] = Timed(network._sessions["main"])
    inside, outside = [], []
    for frame in frames:
        session.seconds, clock = 0.0, time.perf_counter()
        next(use(network, [frame]))
        inside.append(session.seconds)
        outside.append(time.perf_counter() - clock - session.seconds)
    within, around = (1e3 * float(np.median(x)) for x in (inside, outside))
    return f"{folder.name:<20} network {within:6.1f} ms  around it {around:5.2f} ms  of 50 ms: {100 * around / 50:4.1f} %"


def main() -> None:
    """Both networks."""
    cv2.setNumThreads(1)
    models, video = map(Path, sys.argv[1:3])
    frames = [cv2.imread(str(path)) for path in sorted(video.glob("*.jpg"))[:FRAMES]]
    grid = round(frames[0].shape[0] * 427 / frames[0].shape[1]), 427
    with threadpool_limits(1):  # as in a worker
        print(measure(models / "tcmonodepth-small", lambda n, f: network_depth(n, f, grid), frames))
        print(measure(models / "yolov8n-seg", network_instances, frames))


if __name__ == "__main__":
    main()
