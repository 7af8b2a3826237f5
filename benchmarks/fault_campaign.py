"""Workers, scheduler and client are killed at random while a batch runs; the same command goes on until all is done.

    python benchmarks/fault_campaign.py OUT [--kills 300] [--seed 0] [--clusters local separate serial]
        [--source FOLDER ... --set frames.width=128] [--store moto]

OUT is an empty folder. A batch is ten tiny clips, or what ``--source`` names. ``local`` is the cluster of ``zsmoseg run``,
``separate`` a scheduler and workers of their own, which are started again when they die; ``serial`` has a client only. Kills are
SIGKILL, ``interrupt`` is Ctrl-C. Most come in the middle of the work, the others anywhere, start and end included.

A failure is: a command that does not end, ends with a code or words that do not fit what was killed, or with a traceback; a
finished part that was written again; at the end arrays, masks or tables that differ from those of an undisturbed run in a bit,
a finding of ``verify``, a process that outlived its run, an unfinished file or lease that the next run and ``gc`` do not take away
an hour later. The exit code is 1 if there is one.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from batches import (
    CLUSTER,
    bucket,
    differences,
    events,
    finished,
    results,
    stamps,
    start,
    undone,
    unfinished,
    write_batch,
)
from killable import CLUSTERS, Local, Serial, children

from zsmoseg.stores.location import Store
from zsmoseg.stores.upkeep import verify

PATIENCE = 60
"""Seconds that a client waits for workers."""
ENDLESS = 240.0
"""Seconds without a kill within which every command ends."""
A_BATCH = 8
"""Kills of one batch at most: it has to come to its end."""
STARTS = 200
"""Times that the command is started for one batch at most."""
AT_WORK = 0.75
"""Share of the kills that wait until parts are computed."""
SIGNALS = {"interrupt": signal.SIGINT}
CODES = {"scheduler": {1, 2}, "worker": {1, 2}, "interrupt": {130, -signal.SIGINT}}
"""How a command may end, beside 0, after that was killed under it; shells call both of Ctrl-C 130."""
WORDS = {
    "scheduler": ("scheduler", "dropped the work"),
    "worker": ("the worker died again and again", "the local cluster did not start", "workers"),
}
"""One of these is in what it says when it does not end with 0."""


@dataclass
class Tally:
    """What was killed, and what went wrong, by (cluster, kind)."""

    kills: Counter[tuple[str, str]] = field(default_factory=Counter)
    at_work: Counter[tuple[str, str]] = field(default_factory=Counter)
    failures: Counter[tuple[str, str]] = field(default_factory=Counter)
    batches: Counter[str] = field(default_factory=Counter)

    def fail(self, cluster: str, kind: str, text: str) -> None:
        """Count it and say it at once."""
        self.failures[cluster, kind] += 1
        print(f"FAILURE {cluster}, {kind}: {text}", flush=True)


@dataclass
class Batch:
    """One batch, from its first command to the last."""

    name: str
    place: Path
    store: str
    words: list[str]
    draw: random.Random
    tally: Tally
    kills: int
    killed: list[str] = field(default_factory=list)
    starts: int = 0
    done: dict[str, str] = field(default_factory=dict)
    processes: set[psutil.Process] = field(default_factory=set)

    def go(self) -> bool:
        """Start the command again until it says that all is done; False where it fails though nothing was killed."""
        self.place.mkdir()
        cluster = CLUSTERS[self.name](self.place)
        try:
            while self._command(cluster) != 0:
                if not self.killed:
                    return False
                assert self.starts < STARTS, f"{self.place}: {STARTS} starts and not done"
        finally:
            cluster.close()
        return True

    @property
    def told(self) -> Path:
        """What the command prints that runs now."""
        return self.place / f"client{self.starts:03d}.txt"

    @property
    def events(self) -> Path:
        """Of the command that runs now."""
        return self.place / f"events{self.starts:03d}.jsonl"

    def _words(self, cluster: Local) -> list[str]:
        """The next command; the events of each are in a file of their own."""
        self.starts, self.killed = self.starts + 1, []
        where = ["-o", str(self.place / "out"), "--store", self.store, "--patience", str(PATIENCE)]
        return ["run", *self.words, *where, *cluster.words, "--events", str(self.events)]

    def _command(self, cluster: Local) -> int:
        """One command, from its start to its end or death."""
        cluster.restore()
        words = self._words(cluster)
        client = start(words, self.told, CLUSTER)
        try:
            while self._due(client, cluster):
                self._kill(client, cluster)
        finally:
            client.kill()
        code = client.wait()
        if "client" not in self.killed:
            self._check_end(code)
        return code

    def _due(self, client: subprocess.Popen[bytes], cluster: Local) -> bool:
        """Wait until the next kill is due; False once the command has ended."""
        at_work, delay = self.draw.random() < AT_WORK, self.draw.uniform(0, 1)
        delay = delay if at_work else 3 * delay
        begun = due = time.monotonic()
        while client.poll() is None:
            cluster.restore(again=False)
            self.processes |= set(children(psutil.Process(client.pid)))
            now = time.monotonic()
            if at_work and not self._working():
                due = now
            if self.kills and now > due + delay and "client" not in self.killed:
                return True
            if now > begun + ENDLESS:
                self.tally.fail(self.name, self._last, f"{self.told}: does not end")
                client.kill()
            time.sleep(0.02)
        return False

    def _working(self) -> bool:
        """Whether the command that runs has computed something."""
        return any(event["event"] == "part" for event in events(self.events))

    def _kill(self, client: subprocess.Popen[bytes], cluster: Local) -> None:
        kind, at_work = self.draw.choice(cluster.kinds), self._working()
        if kind == "interrupt" and not at_work:
            kind = "client"  # Ctrl-C while Python itself starts is Python's
        victims = cluster.victims(psutil.Process(client.pid), kind)
        if not victims:
            return
        self._look_at_finished(kind)
        with suppress(psutil.NoSuchProcess):  # it ended by itself just now
            self.draw.choice(victims).send_signal(SIGNALS.get(kind, signal.SIGKILL))
        self.kills -= 1
        self.killed.append(kind)
        self.tally.kills[self.name, kind] += 1
        self.tally.at_work[self.name, kind] += at_work

    def _look_at_finished(self, kind: str) -> None:
        """What was finished before must be there as it was."""
        now = stamps(self.store)
        wrong = undone(self.done, now)
        if wrong:  # or one was sealed while its folder was listed: what is gone stays gone
            now = stamps(self.store)
            wrong = undone(self.done, now)
        if wrong:
            self.tally.fail(
                self.name,
                kind,
                f"{self.store}: {len(wrong)} finished parts gone or written again: {wrong[0]}",
            )
        self.done |= finished(now)

    @property
    def _last(self) -> str:
        """What is blamed."""
        return self.killed[-1] if self.killed else "nothing"

    def _check_end(self, code: int) -> None:
        """Exit code and words fit what was killed."""
        text = self.told.read_text()
        fits = code in set().union({0}, *(CODES[kind] for kind in self.killed)) and "Traceback" not in text
        if fits and code in (1, 2):
            fits = any(word in text for kind in self.killed for word in WORDS.get(kind, ()))
        if not fits:
            self.tally.fail(self.name, self._last, f"{self.told}: ended with {code}\n{text[-1500:]}")

    def check(self, expected: dict[str, str]) -> None:
        """All that must hold when the batch is done."""
        self._look_at_finished("end")
        found = differences(expected, results(self.store, self.place / "out"))
        if found:
            self.fail_at_end(f"{self.place}: {len(found)} differ: {', '.join(found[:5])}")
        for damage in verify(Store.open(self.store, create=False)):
            self.fail_at_end(f"{damage.path}: {damage.what}")
        self._clear()
        _, alive = psutil.wait_procs(self.processes, timeout=20)
        for process in alive:
            self.fail_at_end(f"process {process.pid} outlived its run")
            process.kill()

    def fail_at_end(self, text: str) -> None:
        """Something that no single kill is blamed for."""
        self.tally.fail(self.name, "end", text)

    def _clear(self) -> None:
        """What is left of killed processes goes an hour later, with the next run or with ``gc``; nothing is to be computed."""
        places = [self.store, str(self.place / "out")]
        for path in unfinished(*places):
            if "://" not in path:
                os.utime(path, (1, 1))
        again, told = self._words(Serial(self.place)), self.place / "again.txt"
        codes = [start(words, told).wait() for words in (again, ["gc", "--yes", "--store", self.store])]
        left = [*unfinished(*places), *(e["stage"] for e in events(self.events) if e["event"] == "part")]
        if any(codes) or left:
            self.fail_at_end(f"{self.place}: once more: {codes}, {', '.join(left)}")


def print_table(tally: Tally, seed: int, seconds: float) -> None:
    """A line a kind of kill."""
    print(
        "| cluster | killed | kills | while parts were computed | failures |\n| --- | --- | --- | --- | --- |"
    )
    for cluster, kind in sorted(tally.kills | tally.failures):
        key = cluster, kind
        print(f"| {cluster} | {kind} | {tally.kills[key]} | {tally.at_work[key]} | {tally.failures[key]} |")
    print(
        f"{tally.kills.total()} kills in {tally.batches.total()} batches, {tally.failures.total()} failures, seed {seed}, "
        f"{seconds:.0f} s"
    )


def main() -> int:
    """Run it; 1 if something failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("out", type=Path)
    add("--kills", type=int, default=300)
    add("--seed", type=int, default=0)
    add("--clusters", nargs="+", choices=CLUSTERS, default=["local", "separate"])
    add("--source", nargs="+")
    add("--videos", type=int, default=10, help="clips of the synthetic batch")
    add("--set", action="append", default=["chunk.length=4", "overlay.write=false"])
    add("--store", help="URL below which the stores go, or moto: an S3 server of its own (default: OUT)")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    with bucket(given.out / "server.txt") if given.store == "moto" else nullcontext(given.store) as url:
        return run_all(given, url)


def run_all(given: argparse.Namespace, url: str | None) -> int:
    """All batches, and the table; ``url``: where the stores are, if not in OUT."""
    clock, root = time.monotonic(), given.out.absolute()
    sources = given.source or write_batch(root / "clips", given.videos)
    words = [*sources, *(word for text in given.set for word in ("--set", text))]
    alone = ["run", *words, "--scheduler", "serial", "--store", str(root / "alone/store")]
    assert start([*alone, "-o", str(root / "alone/out")], root / "alone.txt").wait() == 0
    expected, tally = results(str(root / "alone/store"), root / "alone/out"), Tally()
    draw, number, most = random.Random(given.seed), 0, min(A_BATCH, -(-given.kills // len(given.clusters)))
    while (left := given.kills - tally.kills.total()) > 0:
        name, place = given.clusters[number % len(given.clusters)], root / f"{number:04d}"
        store = f"{url}/{number:04d}" if url else str(place / "store")
        batch = Batch(name, place, store, words, random.Random(draw.random()), tally, min(left, most))
        if not batch.go():
            break
        batch.check(expected)
        tally.batches[name] += 1
        print(f"batch {number}: {name}, {batch.starts} starts, {tally.kills.total()} kills", flush=True)
        number += 1
    print_table(tally, given.seed, time.monotonic() - clock)
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main())
