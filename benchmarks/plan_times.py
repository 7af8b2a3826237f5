"""Seconds before and beside the computing: a plan of many chunks, their status, a run with nothing to do, going on after a kill.

    python benchmarks/plan_times.py OUT [--chunks 5000] [--videos 500] [--per-video 50]

OUT is an empty folder. All are commands in processes of their own, with their imports: seconds of wall and processor.

plan      ``run --dry-run`` over videos of one-frame chunks, ``--chunks`` of them in all, with an empty store; then again where
          the fingerprints are known
status    ``status`` after ``run --until frames`` of these: a finished part a chunk
no-op     ``run`` over ``--videos`` tiny videos of one chunk that are done
resume    ``run`` on a local cluster of two workers is killed in the middle; from the start of the next one to its first finished part
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from batches import CLUSTER, events, start, write_batch
from PIL import Image

TINY = ["--set", "chunk.length=1"]


def write_many(folder: Path, videos: int, frames: int) -> list[str]:
    """Videos that differ in their first frame only."""
    write_batch(folder.with_name(f"{folder.name}-first"), 1, frames, (32, 48))
    first = folder.with_name(f"{folder.name}-first") / "clip0000"
    for number in range(videos):
        place = folder / f"clip{number:04d}"
        shutil.copytree(first, place)
        image = np.asarray(Image.open(place / "00000.png")).copy()
        image.flat[:2] = divmod(number, 256)
        Image.fromarray(image).save(place / "00000.png")
    return [str(folder)]


def timed(words: Sequence[str], told: Path) -> tuple[float, float]:
    """Seconds of wall and processor of one command, which has to end with 0."""
    begun = time.monotonic()
    _, status, used = os.wait4(start(words, told).pid, 0)
    assert status == 0, told.read_text()[-2000:]
    return time.monotonic() - begun, used.ru_utime + used.ru_stime


def wait_for(moment: Callable[[], bool], seconds: float = 120.0) -> float:
    """Seconds until something is so."""
    begun = time.monotonic()
    while not moment():
        assert time.monotonic() < begun + seconds, "it does not come"
        time.sleep(0.01)
    return time.monotonic() - begun


def resume(sources: list[str], root: Path) -> float:
    """Seconds from the start of the command that goes on to its first finished part."""
    found = 0.0
    for number in range(2):
        path = root / f"events{number}.jsonl"
        places = ["-o", str(root / "out"), "--store", str(root / "store"), "--events", str(path)]
        local = ["--scheduler", "local", "--workers", "2", "--set", "chunk.length=4"]
        command = start(["run", *sources, *places, *local], root / "resume.txt", CLUSTER)
        found = wait_for(lambda path=path: any(event["event"] == "part" for event in events(path)))  # type: ignore[misc]
        command.kill()
        command.wait()
    return found


def say(what: str, count: str, times: tuple[float, float]) -> None:
    """A line of the table."""
    print(f"| {what} | {count} | {times[0]:.2f} | {times[1]:.2f} |", flush=True)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--chunks", type=int, default=5000)
    parser.add_argument("--per-video", type=int, default=50)
    parser.add_argument("--videos", type=int, default=500)
    given = parser.parse_args()
    root, told = given.out.absolute(), given.out.absolute() / "told.txt"
    root.mkdir(parents=True, exist_ok=True)
    places = ["-o", str(root / "out"), "--store", str(root / "store"), "--scheduler", "serial"]
    print("| what | of | wall s | processor s |\n| --- | --- | --- | --- |")
    chunks = write_many(root / "chunks", max(1, given.chunks // given.per_video), given.per_video)
    of = f"{given.chunks} chunks"
    say("plan, empty store", of, timed(["run", *chunks, *places, *TINY, "--dry-run"], told))
    timed(["run", *chunks, *places, *TINY, "--until", "frames"], told)
    say("plan, fingerprints known", of, timed(["run", *chunks, *places, *TINY, "--dry-run"], told))
    say("status", of, timed(["status", "--store", str(root / "store")], told))
    many = write_many(root / "many", given.videos, 4)
    run = [
        "run",
        *many,
        "-o",
        str(root / "out-many"),
        "--store",
        str(root / "store-many"),
        "--scheduler",
        "serial",
    ]
    say("first run", f"{given.videos} videos", timed(run, told))
    say("no-op", f"{given.videos} videos", timed(run, told))
    seconds = resume(write_batch(root / "batch", 4), root)
    print(f"| resume after a kill | first finished part | {seconds:.2f} | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
