"""A sandbox with files that nobody may touch, a watch over what a process opens, and names that try to get out."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from random import Random
from typing import Any

ONE_PATH = {
    "os.listdir",
    "os.scandir",
    "os.remove",
    "os.mkdir",
    "os.rmdir",
    "os.truncate",
    "os.chmod",
    "os.utime",
}
TWO_PATHS = {"os.rename", "os.link", "os.symlink"}
READS = {"os.listdir", "os.scandir"}
PARTS = (
    "..",
    ".",
    "",
    "a",
    "masks",
    "outside",
    "canary.png",
    "store",
    "...",
    " ",
    "\n",
    "C:",
    "~",
    "x" * 300,
)


class Sandbox:
    """``root/outside`` and files beside every folder that may be used; ``allowed`` may be read and written."""

    def __init__(self, root: Path, allowed: list[Path]) -> None:
        self.root, self.allowed = root.resolve(), [path.resolve() for path in allowed]
        for folder in {self.root, self.root / "outside", *(path.parent for path in self.allowed)}:
            for name in ("canary.png", "canary.json", "canary", "00000.png", "a.png"):
                folder.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(f"canary {name}".encode())

    def is_outside(self, path: Path) -> bool:
        inside = any(path.is_relative_to(allowed) for allowed in self.allowed)
        return path.is_relative_to(self.root) and not inside

    def state(self) -> dict[str, Any]:
        """Content, time of change and kind of all that lies outside."""
        found = {}
        for folder, folders, names in os.walk(self.root):
            for name in [*names, *folders]:
                path = Path(folder) / name
                if self._above(path) or not self.is_outside(path):
                    continue
                about = path.lstat()
                data = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
                when = 0 if path.is_dir() else about.st_mtime_ns
                found[str(path)] = (about.st_mode, when, sha256(data).hexdigest())
            folders[:] = [f for f in folders if self.is_outside(Path(folder) / f)]
        return found

    def _above(self, path: Path) -> bool:
        return any(allowed.is_relative_to(path) for allowed in self.allowed)

    @contextmanager
    def untouched(self, reads: bool = True) -> Iterator[None]:
        """Around what may touch nothing outside, and (``reads``) read nothing there."""
        before = self.state()
        _watch.seen = []
        _watch.on = True
        try:
            yield
        finally:
            _watch.on = False
        touched = [(e, p) for e, p, w in _watch.seen if self.is_outside(p) and (reads or w)]
        assert not touched, touched
        after = self.state()
        changed = {path for path in before.keys() | after.keys() if before.get(path) != after.get(path)}
        assert not changed, changed


class _Watch:
    """What this process opened, listed, made and removed; a hook of Python cannot be taken off again."""

    def __init__(self) -> None:
        self.on, self.seen = False, list[tuple[str, Path, bool]]()
        sys.addaudithook(self)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = bool((flags or 0) & (os.O_WRONLY | os.O_RDWR)) or any(c in str(mode) for c in "wxa+")
            if isinstance(path, str | bytes | os.PathLike):
                self.seen.append((event, Path(os.path.realpath(os.fsdecode(path))), writes))
        elif event in ONE_PATH | TWO_PATHS:
            for path in arguments[: 2 if event in TWO_PATHS else 1]:
                if isinstance(path, str | bytes | os.PathLike):
                    folder, name = os.path.split(os.path.abspath(os.fsdecode(path)))
                    self.seen.append((event, Path(os.path.realpath(folder)) / name, event not in READS))


_watch = _Watch()


def hostile(count: int, seed: int, root: Path) -> list[str]:
    """Names that lead out of a folder some levels below ``root``, or are none."""
    rng = Random(seed)
    known = [
        "../canary.png", "../../canary.png", "../../../canary.png", "../outside/canary.png", "..", ".", "", "/", "//",
        "../../outside/canary", "a/../../canary.png", "masks/../../canary.png", "./../canary.png", "..\\canary.png",
        f"{root}/outside/canary.png", f"/{root}/canary.png", f"{root}/outside", "C:\\canary.png", "C:canary.png",
        "\0", "../canary.png\0.png", "a\0", "../outside", "....//canary.png", "~/canary.png", "x" * 300, "../" * 90,
    ]  # fmt: skip
    while len(known) < count:
        name = rng.choice("///\\").join(rng.choices(PARTS, k=rng.randint(2, 6)))
        known.append(rng.choice(["", "", "/", f"{root}/"]) + name)
    return known[:count]
