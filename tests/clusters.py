"""Dask clusters of real processes for tests: any of them can be killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from zsmoseg.workflows.running.jobs import Job, Outcome

TESTS = Path(__file__).parent
WAIT = 60.0


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that must come."""
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end, "what must come did not come"
        time.sleep(0.05)


class Cluster:
    """A scheduler and workers, each a process without a nanny; ``words`` are for all of them."""

    def __init__(self, root: Path, *words: str) -> None:
        root.mkdir(exist_ok=True)
        self.root, self.file, self.words = root, root / "scheduler.json", words
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start("scheduler", "--port", "0", "--scheduler-file", str(self.file))
        until(self.file.exists)

    def _start(self, *words: str, first: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
        path = os.pathsep.join(map(str, [*first, TESTS.parent, TESTS]))
        command = [sys.executable, "-m", "dask", *words, "--host", "127.0.0.1", "--no-dashboard", *self.words]
        return subprocess.Popen(
            command,
            cwd=self.root,
            env={**os.environ, "PYTHONPATH": path},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def worker(self, *words: str, first: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
        """Start one more; what lies in ``first`` is imported before anything else."""
        more = ["--scheduler-file", str(self.file), "--nthreads", "1", "--no-nanny", "--death-timeout", "20"]
        started = self._start("worker", *more, *words, first=first)
        self.workers.append(started)
        return started

    def kill_workers(self) -> None:
        for worker in self.workers:
            kill(worker)
        self.workers.clear()


def kill(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()


@contextmanager
def cluster(root: Path, workers: int = 1, *words: str) -> Iterator[Cluster]:
    made = Cluster(root, *words)
    try:
        for _ in range(workers):
            made.worker()
        yield made
    finally:
        for process in (*made.workers, made.scheduler):
            kill(process)


def certificate(root: Path) -> tuple[Path, Path]:
    """A certificate that signs itself, and its key: what TLS asks of scheduler, workers and clients."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(key, hashes.SHA256())
    )
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    paths = root / "certificate.pem", root / "key.pem"
    for path, content in zip(paths, (made.public_bytes(Encoding.PEM), secret), strict=True):
        path.write_bytes(content)
    return paths


def job(part: int, out: Path, seconds: float = 0.0, network: bool = False) -> Job:
    """A job for ``pretend``."""
    settings = {"seconds": seconds}
    return Job(
        "", "video", "stage", "k" * 12, part, part, part + 1, "", settings, {}, str(out), network=network
    )


def pretend(job: Job, *before: Outcome) -> Outcome:
    """In the place of ``run_job``: leaves a line a try, takes as long as it is told."""
    with open(job.out, "a") as file:
        file.write(f"{job.part}\n")
    time.sleep(job.settings["seconds"])
    return Outcome("done")
