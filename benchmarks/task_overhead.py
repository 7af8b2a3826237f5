"""What a tiny video costs beside its own computing: processor time of store, records and plan, a task and a video.

    python benchmarks/task_overhead.py [VIDEOS] [FRAMES]

Synthetic videos of 64 x 48 pixels through the serial executor, in one process that is warm. "in tasks" is what the stages
themselves take, reading their inputs included; the rest is planning, laying out, writing and describing.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from clips import tiny_videos

from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.stages.graph import GRAPHS

WARM = 2
"""Videos before the first that counts."""


class Clock:
    """Processor time within tasks, and their number."""

    def __init__(self) -> None:
        self.seconds, self.tasks = 0.0, 0

    def timed(self, task: Any) -> Any:
        """The same task with its time taken."""

        def run(*about: Any) -> Iterator[Any]:
            self.tasks += 1
            begun = time.process_time()
            for block in task(*about):
                self.seconds += time.process_time() - begun
                yield block
                begun = time.process_time()
            self.seconds += time.process_time() - begun

        return run


def main(videos: int = 10, frames: int = 4) -> None:
    """Print the table."""
    clock = Clock()
    graph = GRAPHS["embedded-flow"]
    for name, stage in list(graph.items()):
        graph[name] = dataclasses.replace(stage, task=clock.timed(stage.task))  # type: ignore[index]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        sources = tiny_videos(root / "videos", videos + WARM, frames)
        _seconds(sources[:WARM], root)
        clock.seconds = clock.tasks = 0
        one = _seconds(sources[WARM:], root) / videos
        noop = _seconds(sources[WARM:], root) / videos
        left = sum(path.is_file() for path in (root / "store").rglob("*"))
    tasks, inside = clock.tasks / videos, clock.seconds / videos
    print(f"a run of {videos} videos of {frames} frames, {tasks:.0f} tasks each; processor time of a video")
    print(f"  all          {1e3 * one:6.1f} ms")
    print(f"  in tasks     {1e3 * inside:6.1f} ms")
    print(f"  beside them  {1e3 * (one - inside):6.1f} ms, {1e3 * (one - inside) / tasks:.2f} ms a task")
    print(
        f"  again, with nothing to do {1e3 * noop:.1f} ms; {left / (videos + WARM):.1f} files a video in the store"
    )


def _seconds(sources: list[Path], root: Path) -> float:
    begun = time.process_time()
    run(Request([str(source) for source in sources], root / "out", root / "store", scheduler="serial"))
    return time.process_time() - begun


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
