"""What compiling takes: seconds of the processor for all functions of a default run, and for each.

python benchmarks/compiling.py

A small clip is run in a process that finds nothing compiled. ``EACH`` of ``workflows/planning/compiled.py`` is what it
prints last, on a quiet machine.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from zsmoseg.settings import resolve
from zsmoseg.synthetic import demo_scene
from zsmoseg.workflows.cli.demo import write_clip
from zsmoseg.workflows.planning.compiled import missing
from zsmoseg.workflows.running.progress import Tally
from zsmoseg.workflows.running.request import Quiet, Request
from zsmoseg.workflows.running.run import run
from zsmoseg.workflows.stages.graph import GRAPHS


class Count(Quiet):
    """Adds up what comes back."""

    def __init__(self) -> None:
        self.tally = Tally()
        self.part = self.tally.add  # type: ignore[method-assign]


def main() -> None:
    """Print seconds and functions; run again in a process with an empty cache first."""
    if "NUMBA_CACHE_DIR" not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(
                [sys.executable, __file__], env=os.environ | {"NUMBA_CACHE_DIR": folder}, check=True
            )
        return
    functions = {f for stage in GRAPHS["embedded-flow"].values() for f in missing(stage.task.__module__)}
    with tempfile.TemporaryDirectory() as folder:
        root, count = Path(folder), Count()
        write_clip(root / "clip.mp4", demo_scene(0).frames[:6])
        run(Request([str(root / "clip.mp4")], root / "out", root / "store", resolve(), "serial"), count)
    seconds = count.tally.warm_up
    print(f"{len(functions)} functions, {seconds:.1f} s, {seconds / len(functions):.2f} s each")


if __name__ == "__main__":
    main()
