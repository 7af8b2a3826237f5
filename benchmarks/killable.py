"""Clusters whose processes a campaign kills: the one of ``zsmoseg run``, a separate one, none."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import psutil
from batches import python

WAIT = 60.0
"""Seconds in which a scheduler starts."""


class Local:
    """The cluster that the command starts itself."""

    kinds: tuple[str, ...] = ("worker", "client", "interrupt")

    def __init__(self, place: Path) -> None:
        self.words = ["--scheduler", "local", "--workers", "2"]

    def victims(self, client: psutil.Process, kind: str) -> list[psutil.Process]:
        """The processes of a kind that are there now."""
        return children(client) if kind == "worker" else [client]

    def restore(self, again: bool = True) -> None:
        """Nothing is ours."""

    def close(self) -> None:
        """Nothing is ours."""


class Serial(Local):
    """No cluster at all."""

    kinds = ("client", "interrupt")

    def __init__(self, place: Path) -> None:
        self.words = ["--scheduler", "serial"]


class Separate(Local):
    """A scheduler and two workers, each a process; a keeper starts again what died, as batch systems do."""

    kinds = ("worker", "client", "interrupt", "scheduler")

    def __init__(self, place: Path) -> None:
        self.file, self.told = place / "scheduler.json", place / "cluster.txt"
        self.words = ["--scheduler", str(self.file)]
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self.restore()

    def victims(self, client: psutil.Process, kind: str) -> list[psutil.Process]:
        """The processes of a kind that are there now."""
        if kind in ("client", "interrupt"):
            return [client]
        alive = [p for name, p in self.running.items() if name.startswith(kind) and p.poll() is None]
        return [psutil.Process(process.pid) for process in alive]

    def restore(self, again: bool = True) -> None:
        """Start what is not there; ``again`` False: workers only, as a client has to see that its scheduler died."""
        if self._gone("scheduler"):
            if not again:
                return
            self.file.unlink(missing_ok=True)
            self._start("scheduler", "--port", "0", "--scheduler-file", str(self.file))
            end = time.monotonic() + WAIT
            while not self.file.exists():
                assert time.monotonic() < end, "the scheduler does not start"
                time.sleep(0.05)
        for worker in ("worker 0", "worker 1"):
            if self._gone(worker):
                more = ["--nthreads", "1", "--no-nanny", "--death-timeout", "20"]
                self._start(worker, "--scheduler-file", str(self.file), *more)

    def _gone(self, name: str) -> bool:
        return name not in self.running or self.running[name].poll() is not None

    def _start(self, name: str, *words: str) -> None:
        kind = name.split()[0]
        command = ["-m", "dask", kind, "--host", "127.0.0.1", "--no-dashboard", *words]
        self.running[name] = python(command, self.told)

    def close(self) -> None:
        """End all."""
        for process in self.running.values():
            process.kill()
            process.wait()


CLUSTERS = {"local": Local, "separate": Separate, "serial": Serial}


def children(client: psutil.Process) -> list[psutil.Process]:
    """The workers of a command: processes that multiprocessing spawned."""
    try:
        return [child for child in client.children() if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []
