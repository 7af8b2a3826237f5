"""What a kind of storage has to do; ``local`` and ``remote`` do it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path, PurePath
from typing import Any, Protocol

from zsmoseg.remote.looks import Stat


class Growing(Protocol):
    """A file that is being written; a failure before ``close`` leaves something that no record names."""

    def write(self, content: bytes, /) -> Any:
        """Write a piece."""

    def close(self) -> None:
        """No more pieces."""


class Storage(Protocol):
    """Modules are such: the functions here are functions there."""

    def read(self, path: PurePath) -> bytes | None:
        """Content of a file; None where there is none."""

    def read_range(self, path: PurePath, offset: int, length: int) -> bytes | None:
        """``length`` bytes of a file from ``offset`` on, fewer at its end; None where there is none."""

    def signature(self, path: PurePath) -> Stat | None:
        """Of a file what changes when it is written again; None where there is none. Links are followed."""

    def stamp(self, path: PurePath) -> str | None:
        """What changes whenever a file is written, moved or touched; None where there is none, or a link."""

    def size(self, path: PurePath) -> int | None:
        """Size of a file in bytes, or of all files below a folder; None where there is nothing.

        Of a link it is that of the link.
        """

    def listing(self, path: PurePath) -> Mapping[str, Stat]:
        """Every file below a folder, by relative path; links are files, and not followed."""

    def inside(self, path: PurePath) -> list[tuple[str, bool]]:
        """The names in a folder, in order, and whether each is a folder itself. Links are none."""

    def exists(self, path: PurePath) -> bool:
        """Whether there is a file or a folder."""

    def is_folder(self, path: PurePath) -> bool:
        """Whether there is a folder."""

    def closed(self, path: PurePath) -> str | None:
        """Why a file that is there cannot be read; None where it can be, or there is none."""

    def is_link(self, path: PurePath) -> bool:
        """Whether there is a symbolic link."""

    def in_the_way(self, path: PurePath) -> PurePath | None:
        """A file that has the name of the folder ``path``, or of one above."""

    def absolute(self, path: PurePath) -> str:
        """The path as records remember it, wherever who reads them stands."""

    def make_folder(self, path: PurePath) -> None:
        """Make a folder, and those above it."""

    def touch(self, path: PurePath) -> None:
        """Note that a file is used now, where that can be noted without writing it again."""

    def write(self, path: PurePath, content: bytes) -> None:
        """Write a file, and its folders. For files that count for nothing before a record names them."""

    def write_whole(self, path: PurePath, content: bytes, sync: bool = False) -> None:
        """Write a file that appears whole or not at all; ``sync``: on the disk before its name appears."""

    def append(self, path: PurePath) -> Growing:
        """A file that is open for writing; complete when it is closed."""

    def appearing(self, path: PurePath) -> AbstractContextManager[Path]:
        """A local path to write to; at the end that takes the place of ``path``, after an error it is removed."""

    def unlink(self, path: PurePath) -> None:
        """Remove a file, if it is there."""

    def remove(self, path: PurePath) -> None:
        """Remove a file or a folder with all that is in it, if it is there."""

    def create(self, path: PurePath, content: bytes) -> Stat | None:
        """Write a small file that is not there yet; None if it is."""

    def renew(self, path: PurePath, content: bytes, held: Stat) -> Stat | None:
        """Say once more that a file is ours; None if it is not as it was ``held`` any more."""

    def take(self, path: PurePath, content: bytes, seen: Stat) -> Stat | None:
        """Put ``content`` in the place of the file that was ``seen``; None if somebody was faster."""

    def zarr_store(self, path: PurePath) -> Any:
        """What Zarr and xarray open as the group or array in a folder."""

    def zip_store(self, path: PurePath) -> Any:
        """What Zarr and xarray open as the group in a zip."""

    def errors_in_words(self, path: PurePath) -> AbstractContextManager[None]:
        """Around writing by others: their errors become ours, a full disk a ``SpaceError`` that says what is left."""

    def free(self, path: PurePath) -> int | None:
        """Bytes that can still be written; None where nobody knows."""
