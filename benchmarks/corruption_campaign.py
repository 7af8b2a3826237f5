"""Files of a finished store and its output folder are damaged at random: what is found, what is used, what is mended.

    python benchmarks/corruption_campaign.py OUT [--trials 1000] [--seed 0]

OUT is an empty folder. The store holds two tiny clips, and a run of them with other settings beside. A trial damages one file
(a bit flipped, the end cut off, deleted, exchanged with another) or exchanges or deletes a folder, anywhere below store and
output folder; then it reads all arrays, asks ``verify``, and mends: by the same ``run`` again, from a stage drawn at
random, or by ``repair`` first. A failure is

- *used*: an array reads other values than before, or the command ends with 0 and leaves other masks;
- *unseen*: ``verify`` says that all is well, and an array cannot be read;
- *stuck*: ``repair`` and the same command, three times, do not bring back every array and mask, and, with ``gc`` where folders were
  moved to places that no run reaches, a clean ``verify``;
- *words*: a traceback, or an error that nobody foresaw.

The exit code is 1 if there is one.
"""

from __future__ import annotations

import argparse
import io
import random
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

from batches import arrays, differences, images, results, write_batch

from zsmoseg.workflows.cli import main as zsmoseg
from zsmoseg.workflows.stages.graph import GRAPHS

PLACES = {"store": 7, "out": 3}
"""Where damage is done, and how often."""
OTHER = ("--set", "groups.count=2")
TRIES = 3
"""Times that the same command may say that it has to be started again."""
UNFINISHED = ("no finished run", "there is no store", "not finished")
"""What readers are told of a store that lost a record: it says that nothing is done, which is no damage."""
FAILURES = ("used", "unseen", "stuck", "words")
Harm = Callable[[Path, random.Random], str]


# ---------------------------------------------------------------------- harms
def flip(path: Path, draw: random.Random) -> str:
    """One bit."""
    content, place = bytearray(path.read_bytes()), draw.randrange(max(1, path.stat().st_size))
    if not content:
        return "is empty"
    content[place] ^= 1 << draw.randrange(8)
    path.write_bytes(content)
    return f"bit in byte {place}"


def truncate(path: Path, draw: random.Random) -> str:
    """The end is missing, or all."""
    length = draw.choice([0, draw.randrange(max(1, path.stat().st_size))])
    path.write_bytes(path.read_bytes()[:length])
    return f"{length} bytes left"


def delete(path: Path, draw: random.Random) -> str:
    """The file is gone."""
    path.unlink()
    return "deleted"


def exchange(path: Path, draw: random.Random) -> str:
    """Two files have one another's name; often they are of one kind."""
    root = next(parent for parent in path.parents if parent.name in PLACES)
    alike = [p for p in files(root) if p != path and p.name == path.name]
    others = alike if alike and draw.random() < 0.7 else [p for p in files(root) if p != path]
    return swap(path, draw.choice(others))


def exchange_folder(path: Path, draw: random.Random) -> str:
    """Two folders of one depth have one another's name."""
    folder, root = folder_of(path, draw)
    depth = len(folder.relative_to(root).parts)
    alike = [p for p in root.rglob("*") if p.is_dir() and len(p.relative_to(root).parts) == depth]
    return swap(folder, draw.choice(sorted({*alike, folder})))


def delete_folder(path: Path, draw: random.Random) -> str:
    """A folder is gone with all that is in it."""
    folder, _ = folder_of(path, draw)
    shutil.rmtree(folder)
    return f"folder {folder} deleted"


def folder_of(path: Path, draw: random.Random) -> tuple[Path, Path]:
    """A folder that holds ``path``, below store or output folder, and that."""
    root = next(parent for parent in path.parents if parent.name in PLACES)
    above = [parent for parent in path.parents if root in parent.parents]
    return (draw.choice(above) if above else path.parent), root


def swap(one: Path, other: Path) -> str:
    """Exchange the names of two files or folders."""
    if one != other:
        aside = one.with_name("aside")
        one.rename(aside)
        other.rename(one)
        aside.rename(other)
    return f"exchanged with {other}"


HARMS: dict[str, Harm] = {
    "bit flipped": flip,
    "cut off": truncate,
    "deleted": delete,
    "exchanged": exchange,
    "folder exchanged": exchange_folder,
    "folder deleted": delete_folder,
}
WEIGHTS = (30, 20, 20, 20, 6, 4)


# ---------------------------------------------------------------------- trials
def files(root: Path) -> list[Path]:
    """All of them, in order."""
    return sorted(path for path in root.rglob("*") if path.is_file())


@dataclass
class Bench:
    """A finished store and output folder, as they were and as they are."""

    root: Path
    expected: dict[str, str] = field(default_factory=dict)
    tally: Counter[tuple[str, str]] = field(default_factory=Counter)

    @property
    def work(self) -> Path:
        """What is damaged."""
        return self.root / "work"

    def make(self, frames: int) -> None:
        """Compute it."""
        write_batch(self.root / "clips", 2, frames)
        code, told = self.run(*OTHER, out="other")
        assert code == 0, told
        code, told = self.run()
        assert code == 0, told
        self.expected = results(*self.places)
        shutil.copytree(self.work, self.root / "whole")

    def fresh(self) -> None:
        """As it was."""
        shutil.rmtree(self.work)
        shutil.copytree(self.root / "whole", self.work)

    def call(self, *words: str) -> tuple[int, str]:
        """A command in this process: its exit code and what it says."""
        told = io.StringIO()
        with redirect_stdout(told), redirect_stderr(told):
            try:
                code = zsmoseg(words)
            except Exception:
                code = -1
                traceback.print_exc(file=told)
        return code, told.getvalue()

    def run(self, *more: str, out: str = "out") -> tuple[int, str]:
        """The command whose result is looked at."""
        places = ["--store", str(self.work / "store"), "-o", str(self.work / out)]
        fixed = ["--scheduler", "serial", "--set", "chunk.length=3", "--set", "overlay.write=false"]
        return self.call("run", str(self.root / "clips"), *places, *fixed, *more)

    def upkeep(self, *words: str) -> tuple[int, str]:
        """``verify`` or ``repair``."""
        return self.call(*words, "--store", str(self.work / "store"))

    def differs(self) -> bool:
        """Whether an array cannot be read, or anything is not as it was."""
        try:
            return bool(differences(self.expected, results(*self.places)))
        except Exception:
            traceback.print_exc()
            return True

    @property
    def places(self) -> tuple[str, Path]:
        """Store and output folder that are looked at."""
        return str(self.work / "store"), self.work / "out"

    def trial(self, draw: random.Random) -> None:
        """Damage, look, mend."""
        self.fresh()
        (kind,), (place,) = draw.choices([*HARMS], WEIGHTS), draw.choices([*PLACES], [*PLACES.values()])
        path = draw.choice(files(self.work / place))
        what = HARMS[kind](path, draw)
        words: list[str] = []
        code, told = self.upkeep("verify")
        words.append(told)
        failures = set(self._read(code == 1))
        self.tally[kind, "found by verify" if code == 1 else "harmless"] += 1
        failures |= set(self._mend(kind, draw, words))
        if any("Traceback" in text or "unexpected" in text for text in words):
            failures.add("words")
        self.tally[kind, "trials"] += 1
        for failure in sorted(failures):
            self.tally[kind, failure] += 1
            said = "\n".join(text[-1200:] for text in words)
            print(f"FAILURE {failure}: {path.relative_to(self.work)}: {what}\n{said}", flush=True)

    def _read(self, verified: bool) -> list[str]:
        """What is wrong with what readers get of the damaged store."""
        try:
            now = arrays(self.places[0])
        except Exception as error:  # whatever a reader raises is no silence
            return [] if verified or any(text in str(error) for text in UNFINISHED) else ["unseen"]
        wrong = [name for name, values in now.items() if self.expected.get(name) != values]
        return ["used"] if wrong else []

    def _mend(self, kind: str, draw: random.Random, words: list[str]) -> list[str]:
        """Mend by running again or by repair; what is wrong afterwards."""
        failures = []
        if draw.random() < 0.5:
            stage = draw.choice([None, *GRAPHS["embedded-flow"]])
            good = self._again(words, *(["--from", stage] if stage else []))
            left = {name: values for name, values in self.expected.items() if ":" not in name}
            if good and differences(left, images(self.work / "out")):
                failures.append("used")
        self.upkeep("repair", "--yes")
        good = self._again(words, *OTHER, out="other") and self._again(words)
        code, told = self.upkeep("verify")
        words.append(told)
        if code == 1:
            self.tally[kind, "needs gc"] += 1
            words.append(self.upkeep("gc", "--yes")[1])
            code, told = self.upkeep("verify")
            words.append(told)
        if not good or code != 0 or self.differs():
            failures.append("stuck")
        return failures

    def _again(self, words: list[str], *more: str, out: str = "out") -> bool:
        """The same command until it ends with 0, at most so many times; whether it did."""
        for _ in range(TRIES):
            code, told = self.run(*more, out=out)
            words.append(told)
            if code == 0:
                return True
            more = tuple(word for word in more if word in OTHER)  # what --from took back is to do already
        return False


def main() -> int:
    """Run it; 1 if something failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=6)
    given, clock = parser.parse_args(), time.monotonic()
    bench = Bench(given.out.absolute())
    bench.make(given.frames)
    for number in range(given.trials):
        bench.trial(random.Random(given.seed * 1_000_003 + number))
    columns = ("trials", "found by verify", "harmless", "needs gc", *FAILURES)
    print(f"| damage | {' | '.join(columns)} |\n| --- |{' --- |' * len(columns)}")
    for kind in HARMS:
        print(f"| {kind} | {' | '.join(str(bench.tally[kind, column]) for column in columns)} |")
    failed = sum(bench.tally[kind, failure] for kind in HARMS for failure in FAILURES)
    print(f"{given.trials} trials, {failed} failures, seed {given.seed}, {time.monotonic() - clock:.0f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
