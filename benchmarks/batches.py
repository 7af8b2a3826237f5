"""Batches of tiny videos for campaigns: made, run by a process that can be killed, and compared bit for bit."""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import cv2
import numpy as np

import zsmoseg
from zsmoseg.synthetic import video_scene

COMMAND = "import sys; from zsmoseg.workflows.cli import main; sys.exit(main())"
CLUSTER = f"from zsmoseg.workflows.running import run; run.SMALL = 0.0; {COMMAND}"
"""``--scheduler local`` means a cluster, however little there is to do."""
FINISHED = re.compile(r"/records/\d+\.json$|\.zip$")
"""Files of a store that say, once they are there, that a part is finished."""
UNFINISHED = re.compile(r"\.(tmp|lease)$")
"""Files that only killed processes leave."""


def write_batch(folder: Path, videos: int, frames: int = 12, shape: tuple[int, int] = (48, 64)) -> list[str]:
    """Folders of frames with one or two movers before a moving camera."""
    for number in range(videos):
        place = folder / f"clip{number:04d}"
        place.mkdir(parents=True, exist_ok=True)
        scene = video_scene(number, 1 + number % 2, 2, n_frames=frames, shape=shape, exact=False)
        assert scene.frames is not None
        for t, image in enumerate(scene.frames):
            cv2.imwrite(str(place / f"{t:05d}.png"), image)
    return [str(folder)]


def start(words: Iterable[str], told: Path, command: str = COMMAND) -> subprocess.Popen[bytes]:
    """``zsmoseg`` with ``words``, in a process of its own; what it prints goes to ``told``."""
    return python(["-c", command, *words], told)


def python(words: Sequence[str], told: Path) -> subprocess.Popen[bytes]:
    """A Python process that imports this zsmoseg, with one thread in every library; as installed, with compiled modules."""
    root = str(Path(zsmoseg.__file__).parents[1])
    paths = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    told.parent.mkdir(parents=True, exist_ok=True)
    with told.open("ab") as file:
        return subprocess.Popen(
            [sys.executable, "-P", *words],
            env={**os.environ, **single, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": ""},
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
        )


@contextmanager
def bucket(told: Path) -> Iterator[str]:
    """The URL of an empty bucket on an S3 server (moto) in a process of its own; the environment says where it is."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server, address = (
        python(["-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], told),
        f"http://127.0.0.1:{port}",
    )
    os.environ |= {"AWS_ENDPOINT": address, "AWS_ACCESS_KEY_ID": "x", "AWS_SECRET_ACCESS_KEY": "x", "AWS_REGION": "us-east-1",
                   "AWS_ALLOW_HTTP": "true"}  # fmt: skip
    try:
        for _ in range(300):
            with suppress(OSError), urlopen(Request(f"{address}/campaign", method="PUT")):
                break
            time.sleep(0.1)
        yield "s3://campaign"
    finally:
        server.kill()
        server.wait()


def events(path: Path) -> Iterator[dict[str, Any]]:
    """The events of a run so far; a line that a kill cut off is left out."""
    for line in path.read_bytes().splitlines() if path.exists() else ():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def results(store: str, out: Path) -> dict[str, str]:
    """``arrays`` and ``images`` together."""
    return arrays(store) | images(out)


def arrays(store: str) -> dict[str, str]:
    """A digest of every array of every finished video of a store, as users read them."""
    opened, found = zsmoseg.open_store(store), {}
    for name in opened:
        for node in opened[name].tree.subtree:
            for array, values in node.to_dataset(inherit=False).variables.items():
                found[f"{name}:{node.path}/{array}"] = digest(values.values)
    return found


def images(out: Path) -> dict[str, str]:
    """A digest of every image and table below ``out``."""
    paths = [path for path in sorted(out.rglob("*")) if path.suffix in (".png", ".csv")]
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def digest(values: np.ndarray[Any, Any]) -> str:
    """Of type, shape and content."""
    content = repr(values.tolist()).encode() if values.dtype.hasobject else values.tobytes()
    return hashlib.sha256(f"{values.dtype} {values.shape} ".encode() + content).hexdigest()


def differences(expected: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Names that only one has, or that differ."""
    return sorted(k for k in expected.keys() | found.keys() if expected.get(k) != found.get(k))


def stamps(store: str) -> dict[str, str]:
    """What changes when a file of a store is written again, by path: a local folder or a URL."""
    if "://" in store:
        import obstore

        listed = [entry for page in obstore.list(obstore.store.from_url(store)) for entry in page]
        return {f"/{entry['path']}": f"{entry['e_tag']} {entry['last_modified']}" for entry in listed}
    found = {}
    for path in Path(store).rglob("*"):
        try:
            state = path.stat()
        except FileNotFoundError:  # somebody works on it
            continue
        if path.is_file():
            found[f"/{path.relative_to(store).as_posix()}"] = f"{state.st_ino} {state.st_mtime_ns}"
    return found


def finished(found: Mapping[str, str]) -> dict[str, str]:
    """Those ``stamps`` that say of a part that it is finished."""
    return {name: stamp for name, stamp in found.items() if FINISHED.search(name)}


def undone(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """What was ``finished`` before and is not as it was; when an artifact is sealed, records of its parts become one."""
    wrong = []
    for name, stamp in before.items():
        sealed = f"{name.rpartition('/')[0]}/done.json" in now
        if now.get(name, stamp if sealed else "") != stamp:
            wrong.append(name)
    return wrong


def unfinished(*places: str) -> list[str]:
    """What killed processes left in stores and folders."""
    return [place + name for place in places for name in stamps(place) if UNFINISHED.search(name)]
