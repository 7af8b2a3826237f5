"""A small artifact with every kind of array, and what harms files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.location import Store
from zsmoseg.stores.schema import ArraySpec

FINGERPRINT = "0123456789abcdef" * 4
SIZE = (6, 7)


def cut(frames: int, length: int) -> list[tuple[int, int]]:
    return [(a, min(a + length, frames)) for a in range(0, frames, length)]


def specs(frames: int) -> list[ArraySpec]:
    pairs, scale = ("pair", "component", "y", "x"), 1 / 64
    return [
        ArraySpec("frame", ("frame", "y", "x", "channel"), (frames, *SIZE, 3), "uint8", long_name="frame"),
        ArraySpec(
            "forward", pairs, (frames - 1, 2, *SIZE), "int16", -32768, scale, "px", "flow", kind="flow"
        ),
        ArraySpec("label", ("frame", "y", "x"), (frames, *SIZE), "uint16", long_name="object", kind="label"),
    ]


def content(frames: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Whole arrays; flow in steps of 1/64 px, so that nothing is lost."""
    rng = np.random.default_rng(seed)
    return {
        "frame": rng.integers(0, 256, (frames, *SIZE, 3), np.uint8),
        "forward": (rng.integers(-9000, 9000, (frames - 1, 2, *SIZE)) / 64).astype(np.float32),
        "label": rng.integers(0, 5, (frames, *SIZE), np.uint16),
    }


def write_part(artifact: Artifact, part: int, whole: dict[str, np.ndarray], **more: Any) -> None:
    start, stop = artifact.parts[part]
    tables = {
        "state": np.arange(start, min(stop, len(whole["forward"])), dtype=np.int32),
        "nothing": np.zeros((0, 4), np.float32),
        "flags": np.array([True, False, True]),
        "scalar": np.float64(part),
    }
    artifact.write(part, {name: values[start:stop] for name, values in whole.items()}, tables, **more)


def make_store(root: Path) -> Store:
    store = Store.open(root / "store", create=True)
    store.describe_video(store.video_id("goat", FINGERPRINT), "goat.mp4", FINGERPRINT, {"frames": 10})
    return store


def make_artifact(
    store: Store, key: str = "k0", frames: int = 10, length: int = 4, seed: int = 0
) -> Artifact:
    """Written and sealed."""
    artifact = store.artifact(store.video_id("goat", FINGERPRINT), "flow", key)
    artifact.begin({"stage": "flow", "key": key, "settings": {}}, cut(frames, length), specs(frames))
    whole = content(frames, seed)
    for part in range(len(artifact.parts)):
        write_part(artifact, part, whole)
    artifact.seal()
    return artifact


def delete(path: Path) -> None:
    path.unlink()


def empty(path: Path) -> None:
    rewrite(path, b"")


def truncate(path: Path) -> None:
    rewrite(path, path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path, place: int | None = None) -> None:
    """One bit, size and all else as it was; ``place``: which byte."""
    changed = bytearray(path.read_bytes())
    changed[len(changed) // 2 if place is None else place] ^= 1
    rewrite(path, bytes(changed))


def rewrite(path: Path, data: bytes) -> None:
    """In a file of its own, so that the time of change is not all that tells the two apart."""
    other = path.with_name("other")
    other.write_bytes(data)
    other.replace(path)


def data_files(artifact: Artifact) -> dict[str, bytes]:
    return {
        p.relative_to(artifact.data).as_posix(): p.read_bytes()
        for p in sorted(artifact.data.rglob("*"))
        if p.is_file()
    }
