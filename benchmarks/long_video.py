"""What a long shot takes in memory: peak resident size of every stage, for 600 frames and for N.

    python benchmarks/long_video.py [N [SETTING=VALUE ...]]

One static camera, 64 x 48 px, one shot; every 20 frames something new crosses the picture, so that the objects of the
shot grow with its length, as they do in a street. Linux only: the kernel is asked to forget the peak before each task.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import cv2

from zsmoseg.settings import resolve
from zsmoseg.synthetic.street import street
from zsmoseg.workflows.running import executors
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

WIDTH = 64
SHORT = 600
"""Frames of one window."""


def write_clip(folder: Path, frames: int) -> Path:
    """A folder of PNG."""
    folder.mkdir(parents=True)
    for t, (frame, _) in enumerate(street(frames)):
        cv2.imwrite(str(folder / f"{t:05d}.png"), frame)
    return folder


def peak_mb() -> float:
    """Peak resident size since ``forget_peak``."""
    return (
        int(
            next(
                x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")
            ).split()[1]
        )
        / 1024
    )


def forget_peak() -> None:
    """Begin anew."""
    Path("/proc/self/clear_refs").write_text("5")


def measure(frames: int, overrides: dict[str, str]) -> None:
    """Run a clip, print a row a stage."""
    peaks: dict[str, float] = defaultdict(float)
    seconds: dict[str, float] = defaultdict(float)

    def measured(job: Job, *before: Outcome) -> Outcome:
        forget_peak()
        begun = time.process_time()
        outcome = run_job(job, *before)
        assert outcome.state == "done", outcome
        peaks[job.stage] = max(peaks[job.stage], peak_mb())
        seconds[job.stage] += time.process_time() - begun
        forget_peak()
        return outcome

    executors.run_job = measured
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        clip = write_clip(root / "clip", frames)
        chosen = resolve(overrides={"frames.width": WIDTH, **overrides})
        begun = time.process_time()
        report = run(Request([str(clip)], root / "out", root / "store", chosen, "serial"))
        assert not report.failures, report.failures
        after, total = peak_mb(), time.process_time() - begun
        summary = report.summaries["clip"]
        size = sum(p.stat().st_size for p in root.rglob("*") if p.is_file()) / 1e6
    print(
        f"{frames} frames, {summary['objects']} objects, {summary['moving_groups']} moving groups, {size:.0f} MB on disk"
    )
    for stage, peak in peaks.items():
        print(f"  {stage:<12} {peak:7.0f} MB {1e3 * seconds[stage] / frames:7.2f} ms/frame")
    print(f"  {'seal, report':<12} {after:7.0f} MB")
    print(
        f"  {'all':<12} {max([after, *peaks.values()]):7.0f} MB {1e3 * total / frames:7.2f} ms/frame",
        flush=True,
    )


def main() -> None:
    """Each length in a process of its own."""
    frames, given = int(sys.argv[1]) if len(sys.argv) > 1 else 5000, sys.argv[2:]
    if given[:1] == ["--alone"]:
        measure(frames, dict(pair.split("=", 1) for pair in given[1:]))
        return
    for count in (SHORT, frames):
        subprocess.run([sys.executable, __file__, str(count), "--alone", *given], check=True)


if __name__ == "__main__":
    main()
