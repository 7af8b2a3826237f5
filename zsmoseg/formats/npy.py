"""Arrays in .npy and .npz files, a row at a time: a whole video never has to fit in memory."""

from __future__ import annotations

import math
import weakref
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

from zsmoseg.errors import FormatError
from zsmoseg.video.bounds import BYTES, check_bytes

Array = np.ndarray[Any, Any]
DAMAGED = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, SyntaxError)
"""What numpy, zipfile and Pillow raise for a file that is not what its name says."""


def damaged(path: Path, error: Exception) -> FormatError:
    """The error for a file that cannot be read."""
    return FormatError(f"{path}: cannot be read ({str(error) or type(error).__name__}); make the file anew")


def keys(path: Path) -> list[str]:
    """Names of the arrays of an .npz."""
    try:
        with zipfile.ZipFile(path) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except DAMAGED as error:
        raise damaged(path, error) from error


def only_key(path: Path, else_: str = "") -> str:
    """The name of the only array of an .npz; ``""`` for an .npy.

    Parameters
    ----------
    else_ : what could be given instead, for the error.

    Raises
    ------
    FormatError
        It holds none or several.
    """
    names = [""] if path.suffix.lower() == ".npy" else keys(path)
    if len(names) != 1:
        raise FormatError(f"{path}: holds {', '.join(names) or 'nothing'}; give one array{else_}")
    return names[0]


def load(path: Path) -> dict[str, Array]:
    """The arrays of an .npz, or that of an .npy under the name ``""``; objects are refused.

    Raises
    ------
    FormatError
        If the file is damaged.
    """
    try:
        _check_heads(path)
        found = np.load(path, allow_pickle=False)
        if isinstance(found, np.ndarray):
            return {"": found}
        with found:
            return {key: found[key] for key in found.files}
    except DAMAGED as error:
        raise damaged(path, error) from error


Head = tuple[tuple[int, ...], bool, "np.dtype[Any]"]


def _head(stream: IO[bytes]) -> Head:
    """Shape, whether the first index is the fastest, and type, from the head of an .npy."""
    try:
        head = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
        shape, fortran, dtype = head(stream)
    except OSError:
        raise
    except Exception as error:  # it is Python's own parser that reads it, and raises what it likes
        raise ValueError(f"its head is damaged: {error}") from error
    if min(shape, default=0) < 0:
        raise ValueError(f"states the shape {shape}")
    return shape, fortran, dtype


def _check_heads(path: Path) -> None:
    """Raise ``ValueError`` if arrays say that they hold more than is there, or than may be in memory at once."""
    total = 0
    if not zipfile.is_zipfile(path):
        with path.open("rb") as stream:
            total += _stated(stream, path.stat().st_size, "the array")
    else:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                with archive.open(member) as stream:
                    total += _stated(stream, member.file_size, member.filename)
    check_bytes(total, "what it holds", 2 * BYTES)


def _stated(stream: IO[bytes], size: int, what: str) -> int:
    """Bytes of an array by its head, which are there."""
    shape, _, dtype = _head(stream)
    stated, held = math.prod(shape) * dtype.itemsize, size - stream.tell()
    if stated > held:
        raise ValueError(f"{what} states {stated} bytes of numbers and holds {held}")
    return stated


class Rows:
    """A (T, ...) array in an .npy, or under ``key`` in an .npz; the file is closed when this is forgotten.

    Attributes
    ----------
    shape, dtype
        Of the array, read from its head.
    """

    def __init__(self, path: Path, key: str = "") -> None:
        self.path, self.key = path, key
        try:
            if path.suffix.lower() == ".npy":
                with path.open("rb") as stream:
                    _head(stream)
                self._array: Array | None = np.load(path, mmap_mode="r", allow_pickle=False)
                self.shape, self.dtype = self._array.shape, self._array.dtype
            else:
                self._array = None
                self._open()
            check_bytes(math.prod(self.shape[1:]) * self.dtype.itemsize, "one row")
        except DAMAGED as error:
            raise damaged(path, error) from error

    def _open(self) -> None:
        archive = zipfile.ZipFile(self.path)
        weakref.finalize(self, archive.close)
        self._stream: IO[bytes] = archive.open(f"{self.key}.npy")
        self.shape, fortran, self.dtype = _head(self._stream)
        self._begin = self._stream.tell()
        if fortran or self.dtype.hasobject:
            self._array = load(self.path)[self.key]

    def read(self, index: int) -> Array:
        """One row; in order is fastest, as what is compressed is read from the front."""
        try:
            return np.array(self._array[index]) if self._array is not None else self._next(index)
        except DAMAGED as error:
            raise damaged(self.path, error) from error

    def _next(self, index: int) -> Array:
        count = int(np.prod(self.shape[1:]))
        place = self._begin + index * count * self.dtype.itemsize
        if self._stream.tell() != place:  # a seek that leads nowhere would still switch the checksum off
            self._stream.seek(place)
        content = self._stream.read(count * self.dtype.itemsize)
        return np.frombuffer(content, self.dtype, count).reshape(self.shape[1:])


def write_volume(path: Path, key: str, rows: Any, shape: tuple[int, ...], dtype: str) -> None:
    """Write an .npz with one array, a row at a time, the same bytes each time.

    Parameters
    ----------
    rows : iterable of (H, W) arrays, one for each of ``shape[0]``.
    """
    entry = zipfile.ZipInfo(f"{key}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    head = {"descr": npy.dtype_to_descr(np.dtype(dtype)), "fortran_order": False, "shape": shape}
    with zipfile.ZipFile(path, "w") as archive, archive.open(entry, "w", force_zip64=True) as stream:
        npy.write_array_header_1_0(stream, head)
        for row in rows:
            stream.write(np.ascontiguousarray(row, dtype).tobytes())
