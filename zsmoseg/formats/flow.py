"""Optical flow of one video: a file a pair, or one for all; which directions there are."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from zsmoseg.errors import FormatError
from zsmoseg.formats.flow_files import Flow, as_flow, read_flow, sides
from zsmoseg.formats.names import SIDES, frame_files, others
from zsmoseg.formats.npy import Rows, keys, load
from zsmoseg.formats.overlaps import index_of, text

Direction = Literal["forward", "backward"]
SUFFIX = re.compile(r"[_-](fw|bw|forward|backward)$", re.IGNORECASE)
"""End of a stem that tells the direction."""


class FlowSource:
    """The flow of the pairs of one video.

    Parameters
    ----------
    path
        What errors begin with.
    frames
        Name of the first frame of each pair; None where the file knows only their order.
    count
        Number of pairs.
    readers
        For each direction that there is, a function from the index of a pair to its flow and where it stands.
    left_out
        What of the folder is no flow: how many of what, in words.
    """

    def __init__(
        self,
        path: Path,
        frames: list[str] | None,
        count: int,
        readers: dict[str, Callable[[int], tuple[Flow, str]]],
        left_out: Counter[str] | None = None,
    ) -> None:
        self.path, self.frames, self.count, self._readers = path, frames, count, readers
        self.left_out = left_out or Counter()
        self._size: tuple[int, ...] | None = None

    @property
    def has_backward(self) -> bool:
        """Whether there is flow from the second frame of each pair to the first, too."""
        return "backward" in self._readers

    def read(self, entry: int | str, direction: Direction = "forward") -> Flow:
        """(2, H, W) float32, x then y, px of its own grid; NaN where the format says unknown.

        Raises
        ------
        FormatError
            If the file is damaged, not finite, no flow, or of another size than the first; or there is no such
            direction.
        """
        index = entry if isinstance(entry, int) else index_of(self.frames, entry, self.path)
        if direction not in self._readers:
            raise FormatError(f"{self.path}: has no {direction} flow")
        if self._size is None and index > 0:
            self._size = self._readers["forward"](0)[0].shape
        flow, where = self._readers[direction](index)
        self._size = self._size or flow.shape
        if flow.shape != self._size:
            raise FormatError(
                f"{where}: is {text(flow.shape[1:])}, the first {text(self._size[1:])}; give all in one size"
            )
        return flow


def open_flow(path: str | Path) -> FlowSource:
    """Open the flow of one video.

    Parameters
    ----------
    path
        A folder of one file a pair: .flo, KITTI .png, .npy or .npz ((H, W, 2) or (2, H, W)); directions in
        folders ``forward`` and ``backward``, by the ends ``_fw`` and ``_bw`` (``_forward``, ``_backward``) of
        names, or as arrays ``forward`` and ``backward`` of every .npz. A name is that of the first frame of the
        pair; backward files may all be called after the second. Or one .npz (``forward`` and, if known,
        ``backward``) or .npy of the whole video: (pairs, H, W, 2) or (pairs, 2, H, W).

    Raises
    ------
    FormatError
        If it is none of these, or the directions do not fit together.
    """
    path = Path(path)
    if path.is_dir():
        return _open_folder(path)
    if path.is_file() and path.suffix.lower() in (".npy", ".npz"):
        return _open_file(path)
    raise FormatError(f"{path}: is no flow; give a folder of .flo, .png, .npy or .npz, or one .npy or .npz")


def _open_file(path: Path) -> FlowSource:
    """One file of the whole video, or of its only pair."""
    rows = {side: Rows(path, key) for side, key in sides(path).items()}
    shapes = {side: r.shape if len(r.shape) == 4 else (1, *r.shape) for side, r in rows.items()}
    if len({shape[0] for shape in shapes.values()}) > 1 or any(len(shape) != 4 for shape in shapes.values()):
        found = ", ".join(f"{side} {text(r.shape)}" for side, r in rows.items())
        raise FormatError(
            f"{path}: holds {found}; flow is (pairs, y, x, 2) or (pairs, 2, y, x), equally many each way"
        )

    def reader(r: Rows) -> Callable[[int], tuple[Flow, str]]:
        def read(index: int) -> tuple[Flow, str]:
            where = f"{path}, pair {index}"
            return as_flow(r.read(index) if len(r.shape) == 4 else load(path)[r.key], where), where

        return read

    return FlowSource(path, None, shapes["forward"][0], {side: reader(r) for side, r in rows.items()})


def _open_folder(path: Path) -> FlowSource:
    """Files of pairs, sorted by direction."""
    folders = {side: path / side for side in SIDES if (path / side).is_dir()}
    files: dict[str, dict[str, Path]] = {}
    if folders:
        for side, folder in folders.items():
            files[side] = _by_pair(frame_files(folder), side)
    else:
        sorted_out: dict[str, list[Path]] = {}
        for f in frame_files(path):
            end = SUFFIX.search(f.stem)
            side = "backward" if end and end[1].lower().startswith("b") else "forward"
            sorted_out.setdefault(side, []).append(f)
        files = {side: _by_pair(found, side) for side, found in sorted_out.items()}
    if not files.get("forward"):
        raise FormatError(
            f"{path}: holds no forward flow; give .flo, .png, .npy or .npz named like the first frames"
        )
    forward = files["forward"]
    order = {side: _ordered(path, list(forward), named) for side, named in files.items() if named}
    if "backward" not in order and all(_both(file) for file in forward.values()):
        order["backward"] = order["forward"]

    def reader(side: str) -> Callable[[int], tuple[Flow, str]]:
        return lambda index: (read_flow(order[side][index], side), str(order[side][index]))

    taken = [f for named in files.values() for f in named.values()]
    rest = [others(path, [*taken, *folders.values()]), *(others(f, taken) for f in folders.values())]
    return FlowSource(
        path, list(forward), len(forward), {side: reader(side) for side in order}, sum(rest, Counter())
    )


def _by_pair(found: list[Path], side: str) -> dict[str, Path]:
    """The files of one direction by the names of their pairs.

    Raises
    ------
    FormatError
        If a pair has two.
    """
    named: dict[str, Path] = {}
    for file in found:
        pair = SUFFIX.sub("", file.stem)
        if pair in named:
            raise FormatError(
                f"{file.parent}: {named[pair].name} and {file.name} are both the {side} flow of {pair}; keep one of them"
            )
        named[pair] = file
    return named


def _both(file: Path) -> bool:
    """Whether a file of one pair holds both directions."""
    return file.suffix.lower() == ".npz" and set(keys(file)) >= set(SIDES)


def _ordered(path: Path, frames: list[str], named: dict[str, Path]) -> list[Path]:
    """The files of one direction in order of the pairs."""
    names = list(named)
    called_after_second = len(names) == len(frames) and names[:-1] == frames[1:]
    if names != frames and not called_after_second:
        odd = sorted(set(names) ^ set(frames))[0]
        raise FormatError(
            f"{path}: {odd} has flow in one direction only; give both for all pairs, or one for all"
        )
    return list(named.values())
