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
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from zsmoseg.settings import resolve
from zsmoseg.workflows.running import executors
from zsmoseg.workflows.running.jobs import Job, Outcome, run_job
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

HEIGHT, WIDTH = 48, 64
SIDE, EVERY, SPEED = 12, 20, 2
"""px of what crosses; frames from one to the next; px a frame."""
SHORT = 600


def crossing(frames: int) -> Iterator[NDArray[np.uint8]]:
    """The frames (HEIGHT, WIDTH, 3)."""
    rng = np.random.default_rng(0)
    wall = _texture(rng, HEIGHT, WIDTH, 40, 120)
    things = [_texture(rng, SIDE, SIDE, 130, 250) for _ in range(8)]
    rows = rng.integers(2, HEIGHT - SIDE - 2, frames // EVERY + 2)
    for t in range(frames):
        frame = wall.copy()
        for k in range(max(0, (t - (WIDTH + SIDE) // SPEED) // EVERY), t // EVERY + 1):
            x, y = SPEED * (t - k * EVERY) - SIDE, rows[k]
            left, right = max(x, 0), min(x + SIDE, WIDTH)
            if left < right:
                frame[y : y + SIDE, left:right] = things[k % len(things)][:, left - x : right - x]
        yield frame


def _texture(rng: np.random.Generator, height: int, width: int, low: int, high: int) -> NDArray[np.uint8]:
    fine = rng.uniform(low, high, (height, width, 3)).astype(np.float32)
    return (
        np.asarray(cv2.GaussianBlur(fine, (0, 0), 1.0) * 1.5 - 0.25 * (low + high), np.float32)
        .clip(0, 255)
        .astype(np.uint8)
    )


def write_clip(folder: Path, frames: int) -> Path:
    """A folder of PNG."""
    folder.mkdir(parents=True)
    for t, frame in enumerate(crossing(frames)):
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
