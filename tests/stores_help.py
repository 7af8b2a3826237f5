"""A small artifact with every kind of array, and what harms files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import ABOUT, Artifact, part_name, tables_name
from zsmoseg.stores.beginning import begin, plan_of
from zsmoseg.stores.fields import table, video, videos_of
from zsmoseg.stores.inside import Folder, Memory
from zsmoseg.stores.location import Store
from zsmoseg.stores.schema import ArraySpec
from zsmoseg.stores.sealing import seal
from zsmoseg.stores.writer import PartWriter, write_archive

FINGERPRINT = "0123456789abcdef" * 4
SIZE = (6, 7)
FLOW = ("pair", "component", "y", "x")
DESCRIPTION = {"stage": "flow", "key": "k0", "settings": {}}


@dataclass(frozen=True)
class Everything(Arrays):
    """Every kind of array."""

    image: NDArray[Any] = video("frame", "y", "x", "channel", dtype="uint8", meaning="frame")
    forward: NDArray[Any] = video(
        *FLOW, dtype="int16", meaning="flow", unit="px", fill=-32768, scale=1 / 64, codec="flow"
    )
    label: NDArray[Any] = video("frame", "y", "x", dtype="uint16", meaning="object", codec="label")
    state: NDArray[Any] = table("pair", dtype="int32", meaning="number of the pair")
    nothing: NDArray[Any] = table("row", "column", dtype="float32", meaning="no row at all")
    flags: NDArray[Any] = table("flag", dtype="bool", meaning="three in every part")
    scalar: NDArray[Any] = table(dtype="float64", meaning="of the first part")
    object: NDArray[Any] = table("object", dtype="int64", meaning="of the part")
    residual: NDArray[Any] = table(
        "pair", "model", "object", dtype="float64", meaning="residual", unit="px^2"
    )
    area: NDArray[Any] = table("object", dtype="int64", meaning="sum over the parts", add=True)


def cut(frames: int, length: int) -> list[tuple[int, int]]:
    return [(a, min(a + length, frames)) for a in range(0, frames, length)]


def specs(frames: int) -> list[ArraySpec]:
    sizes = {"frame": frames, "pair": frames - 1, "y": SIZE[0], "x": SIZE[1], "component": 2, "channel": 3}
    return [ArraySpec.of(name, field, sizes) for name, field in videos_of(Everything).items()]


def times(frames: int) -> tuple[list[float], list[str]]:
    return [t / 25 for t in range(frames)], [f"{t:05d}" for t in range(frames)]


def content(frames: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Whole arrays; flow in steps of 1/64 px, so that nothing is lost."""
    rng = np.random.default_rng(seed)
    return {
        "image": rng.integers(0, 256, (frames, *SIZE, 3), np.uint8),
        "forward": (rng.integers(-9000, 9000, (frames - 1, 2, *SIZE)) / 64).astype(np.float32),
        "label": rng.integers(0, 5, (frames, *SIZE), np.uint16),
    }


def block_of(artifact: Artifact, part: int, whole: dict[str, np.ndarray]) -> Everything:
    """What a task leaves of a part: objects 0 and part + 1."""
    start, stop = artifact.parts[part]
    pairs = np.arange(start, min(stop, len(whole["forward"])), dtype=np.int32)
    return Everything(
        start=start,
        stop=stop,
        **{name: values[start:stop] for name, values in whole.items()},
        state=pairs,
        nothing=np.zeros((0, 4), np.float32),
        flags=np.array([True, False, True]),
        scalar=np.float64(part),
        object=np.array([0, part + 1]),
        residual=np.arange(4.0).reshape(2, 2) + pairs[:, None, None],
        area=np.array([10, part + 1]),
    )


def put_blocks(artifact: Artifact, part: int, *blocks: Arrays, **facts: Any) -> None:
    with PartWriter(artifact, part) as writer:
        for block in blocks:
            writer.put(block)
        writer.facts = facts


def write_part(artifact: Artifact, part: int, whole: dict[str, np.ndarray], **facts: Any) -> None:
    put_blocks(artifact, part, block_of(artifact, part, whole), **facts)


def begin_with(
    artifact: Artifact,
    parts: list[tuple[int, int]],
    description: dict[str, Any] | None = None,
    video_arrays: Sequence[ArraySpec] = (),
) -> None:
    begin(artifact, plan_of(description or {}, parts, video_arrays))


def lay_out(artifact: Artifact, frames: int = 10, length: int = 4) -> None:
    begin_with(artifact, cut(frames, length), DESCRIPTION, specs(frames))


def seal_it(artifact: Artifact) -> None:
    seal(artifact, Everything, *times(artifact.parts[-1][1] if artifact.parts else 0))


def make_store(root: Path) -> Store:
    store = Store.open(root / "store", create=True)
    store.describe_video(store.video_id("goat", FINGERPRINT), "goat.mp4", FINGERPRINT)
    return store


def place_of(store: Store, key: str = "k0") -> Artifact:
    return store.artifact(store.video_id("goat", FINGERPRINT), "flow", key)


def make_artifact(
    store: Store, key: str = "k0", frames: int = 10, length: int = 4, seed: int = 0, sealed: bool = True
) -> Artifact:
    """Written, and sealed."""
    artifact = place_of(store, key)
    begin_with(artifact, cut(frames, length), {**DESCRIPTION, "key": key}, specs(frames))
    whole = content(frames, seed)
    for part in range(len(artifact.parts)):
        write_part(artifact, part, whole)
    if sealed:
        seal_it(artifact)
    return artifact


def make_archive(
    store: Store,
    key: str = "k0",
    frames: int = 10,
    seed: int = 0,
    left: Callable[[Artifact, dict[str, np.ndarray]], Iterable[Arrays]] = lambda a, w: [block_of(a, 0, w)],
    **facts: Any,
) -> Artifact:
    """The same as one file; ``left``: the blocks of the content."""
    artifact, whole = place_of(store, key), content(frames, seed)
    laid_out = plan_of({**DESCRIPTION, "key": key}, [(0, frames)], specs(frames))
    blocks = left(replace(artifact, held=Memory({ABOUT: laid_out})), whole)
    write_archive(artifact, laid_out, blocks, Everything, *times(frames), lambda: facts)
    return artifact


# ---------------------------------------------------------------------- places
def record_path(artifact: Artifact, name: str | int) -> Path:
    """Of a record by its name, or of that of a part."""
    return Folder(artifact.path).record_place(part_name(name) if isinstance(name, int) else name)


def shard_path(artifact: Artifact, name: str, part: int) -> Path:
    return artifact.path / artifact.shard(name, part)


def tables_path(artifact: Artifact, part: int) -> Path:
    return artifact.path / tables_name(part)


# ---------------------------------------------------------------------- harm


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


Harm = Callable[[Path], None]
HARMS: list[Harm] = [delete, empty, truncate, flip]
"""What can become of a file."""


def rewrite(path: Path, data: bytes) -> None:
    """In a file of its own, so that the time of change is not all that tells the two apart."""
    other = path.with_name("other")
    other.write_bytes(data)
    other.replace(path)


def data_files(artifact: Artifact) -> dict[str, bytes]:
    """All that is Zarr."""
    return {
        p.relative_to(artifact.path).as_posix(): p.read_bytes()
        for p in sorted(artifact.path.rglob("*"))
        if p.is_file() and "records" not in p.parts
    }
