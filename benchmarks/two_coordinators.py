"""Several runs at once on one store: how many trials end wrong, and how often a part was computed twice.

    python benchmarks/two_coordinators.py FRAMES OUT [TRIALS] [SEED]   (FRAMES may hold several folders of images)

FRAMES is a folder of images (short: every run computes it from nothing), OUT an empty folder for stores and results.
Each trial draws two or four coordinators, whether they differ (in chunk length; in the number of groups too), whether they
share their output folder, and starts them up to 0.5 s apart. Right is a trial whose runs all end with 0, leave no lease, and
leave in every output folder the masks of an undisturbed run: where runs of other groups share one, of either of them.
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


def start(frames: Path, store: Path, out: Path, *settings: str) -> subprocess.Popen[str]:
    """One coordinator, in a process of its own."""
    words = ["run", str(frames), "--store", str(store), "-o", str(out), "--scheduler", "serial"]
    command = [sys.executable, "-c", RUN, *words, *(w for s in settings for w in ("--set", s))]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def digests(out: Path) -> dict[str, str]:
    """Of all masks, by video."""
    found = {}
    for video in sorted(out.iterdir()):
        whole = hashlib.sha256()
        for path in sorted(video.glob("masks/*.png")):
            whole.update(path.read_bytes())
        found[video.name] = whole.hexdigest()
    return found


KINDS = {
    "same": lambda k: ["chunk.length=8"],
    "chunks": lambda k: [f"chunk.length={8 + k}"],
    "groups": lambda k: ["chunk.length=8", f"groups.count={1 + k % 2}"],
}
"""Settings of the k-th coordinator of a trial."""


def trial(draw: random.Random, frames: Path, root: Path, place: Path) -> tuple[str, str]:
    """What was drawn, and what is wrong; nothing where all is right."""
    count, kind, shared = draw.choice((2, 4)), draw.choice(list(KINDS)), draw.random() < 0.5
    outs = [place / ("out" if shared else f"out{k}") for k in range(count)]
    runs = []
    for k, out in enumerate(outs):
        runs.append(start(frames, place / "store", out, *KINDS[kind](k)))
        time.sleep(draw.random() * 0.5)
    told = [run.communicate()[1] for run in runs]
    wrong = [text[-400:] for run, text in zip(runs, told, strict=True) if run.returncode]
    right = {k: digests(root / f"alone{k % 2 if kind == 'groups' else 2}" / "out") for k in range(count)}
    for k, out in enumerate(outs):
        allowed = list(right.values()) if shared else [right[k]]
        for name, digest in digests(out).items():
            if digest not in [masks[name] for masks in allowed]:
                wrong.append(f"other masks in {out / name}")
    wrong += [f"left {path}" for path in place.rglob("*.lease")]
    return f"{count} runs, {kind} settings, {'one OUT' if shared else 'own OUT'}", "\n".join(wrong)


def main() -> None:
    """Print a line a trial, and the sums."""
    frames, root = Path(sys.argv[1]), Path(sys.argv[2])
    trials = int(sys.argv[3]) if len(sys.argv) > 3 else 50
    seed = int(sys.argv[4]) if len(sys.argv) > 4 else 0
    draw, bad = random.Random(seed), 0
    for k, settings in enumerate((["groups.count=1"], ["groups.count=2"], [])):
        assert start(frames, root / f"alone{k}/store", root / f"alone{k}/out", *settings).wait() == 0
    for number in range(trials):
        place = root / f"{number:03d}"
        what, wrong = trial(draw, frames, root, place)
        bad += bool(wrong)
        print(f"{number:3d}: {what}: {'WRONG' if wrong else 'right'}\n{wrong}".strip(), flush=True)
        shutil.rmtree(place)
    print(f"{bad} of {trials} trials wrong (seed {seed})")


if __name__ == "__main__":
    main()
