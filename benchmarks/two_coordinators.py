"""Several runs at once on one store: how many trials end wrong, and how often a part was computed twice.

    python benchmarks/two_coordinators.py FRAMES OUT [TRIALS] [SEED]

FRAMES is a folder of images (short: every run computes it from nothing), OUT an empty folder for stores and results.
Each trial draws two or four coordinators, the same or another chunk length, and starts them up to 0.5 s apart. Right
is a trial whose runs all end with 0 and leave the masks of an undisturbed run; every coordinator has its own output folder.
"""

from __future__ import annotations

import hashlib
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

RUN = "import sys; from zsmoseg.workflows.cli import main; sys.exit(main(sys.argv[1:]))"


def start(frames: Path, store: Path, out: Path, chunk: int) -> subprocess.Popen[str]:
    """One coordinator, in a process of its own."""
    words = ["run", str(frames), "--store", str(store), "-o", str(out), "--scheduler", "serial"]
    command = [sys.executable, "-c", RUN, *words, "--set", f"chunk.length={chunk}"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def digest(out: Path) -> str:
    """Of all masks."""
    whole = hashlib.sha256()
    for path in sorted(out.rglob("masks/*.png")):
        whole.update(path.read_bytes())
    return whole.hexdigest()


def main() -> None:
    """Print a line a trial, and the sums."""
    frames, root = Path(sys.argv[1]), Path(sys.argv[2])
    trials = int(sys.argv[3]) if len(sys.argv) > 3 else 50
    seed = int(sys.argv[4]) if len(sys.argv) > 4 else 0
    draw = random.Random(seed)
    assert start(frames, root / "alone/store", root / "alone/out", 8).wait() == 0
    right, wrong = digest(root / "alone/out"), 0
    for trial in range(trials):
        count, other = draw.choice((2, 4)), draw.random() < 0.5
        place = root / f"{trial:03d}"
        runs = []
        for k in range(count):
            runs.append(start(frames, place / "store", place / f"out{k}", 8 + k * other))
            time.sleep(draw.random() * 0.5)
        told = [run.communicate()[1] for run in runs]
        codes = [run.returncode for run in runs]
        good = not any(codes) and all(digest(place / f"out{k}") == right for k in range(count))
        left = len(list((place / "store").rglob("*.lease")))
        wrong += not good or left > 0
        print(
            f"{trial:3d}: {count} runs, {'other' if other else 'same'} chunks, exit {codes}, {'right' if good else 'WRONG'}",
            flush=True,
        )
        if not good:
            print("\n".join(text[-400:] for text, code in zip(told, codes, strict=True) if code))
        shutil.rmtree(place)
    print(f"{wrong} of {trials} trials wrong (seed {seed})")


if __name__ == "__main__":
    main()
