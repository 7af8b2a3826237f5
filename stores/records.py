"""Small JSON files that appear whole or not at all. Standard library only.

A *record* carries a checksum of its content and of the place where it lies: cut off, emptied, changed by a flipped bit,
or brought there from another video, stage, key or part, it reads as None.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import PurePath
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.files import Stat

RECORDS = "records"
"""The folder of an artifact that has its records."""
RUNS = "runs"
"""The folder of a video that has its records of runs."""
DESCRIPTION = "video.json"
"""The record of a video: where it came from."""
PROBES = "probes"
"""The folder of a video that has the probes of its source: times, names and sizes of the frames that are used."""
ARCHIVE = ".zip"
"""End of the name of an artifact that is one file."""
_FRONT = b'{"checksum": "%s", '
_FRONT_BYTES = len(_FRONT % (b"0" * 8))
FINGERPRINT = 16
"""Characters at the end of a folder's name that count: of a video those of its fingerprint."""


def read_json(path: PurePath) -> dict[str, Any] | None:
    """The object in ``path``; None where it is missing, empty, cut off, nested too deep or no object."""
    try:
        value = json.loads(files.read(path) or b"")
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def write_json(path: PurePath, value: Mapping[str, Any], sync: bool = False) -> None:
    """Write ``value`` beside ``path`` and move it there; ``sync``: on the disk before the name appears.

    Raises
    ------
    SpaceError
        If the disk is full.
    """
    files.write_whole(path, _text(value).encode() + b"\n", sync)


def read_record(path: PurePath) -> dict[str, Any] | None:
    """What ``write_record`` wrote; None where the file is missing or differs from that in anything."""
    return trusted(path, files.read(path) or b"")


def write_record(path: PurePath, value: Mapping[str, Any], sync: bool = False) -> None:
    """Write ``value`` with a checksum, atomically; numpy numbers and arrays become plain ones.

    Raises
    ------
    SpaceError
        If the disk is full.
    ValueError
        If ``value`` holds NaN or infinity.
    """
    files.write_whole(path, vouched(path, value), sync)


def vouched(path: PurePath, value: Mapping[str, Any]) -> bytes:
    """JSON of an object with its checksum in front, for the place ``path``."""
    content = _text(value).encode()
    return _FRONT % _stamp(path, content) + content[1:] + b"\n"


def trusted(path: PurePath, text: bytes) -> dict[str, Any] | None:
    """What ``vouched`` was given; None where a byte differs from that."""
    content = b"{" + text[_FRONT_BYTES:].removesuffix(b"\n")
    if text[:_FRONT_BYTES] != _FRONT % _stamp(path, content):
        return None
    try:
        value: dict[str, Any] = json.loads(content)
    except (ValueError, RecursionError):
        return None
    return value


def _stamp(path: PurePath, content: bytes) -> bytes:
    """The checksum of a record, for the place where it lies: 8 hexadecimal digits of CRC-32.

    The place is what stands below the store: a store may be moved. Of a video's folder the end counts, which is its
    fingerprint: people may call it otherwise.
    """
    depth = (
        5 if path.parent.name == RECORDS else 3 if path.suffix == ARCHIVE or path.parent.name == PROBES else 2
    )
    place = "/".join([*(name[-FINGERPRINT:] for name in path.parts[-depth:-1]), path.name])
    return b"%08x" % zlib.crc32(content, zlib.crc32(place.encode()))


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """``value`` as it will be read back: lists for tuples and arrays, text for keys."""
    plain = json.loads(_text(value))
    assert isinstance(plain, dict)
    return plain


def _text(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot stand in a record")


def recall_record(path: PurePath) -> dict[str, Any] | None:
    """As ``read_record``, parsed once while the file stays the same; not to be changed by who gets it."""
    signature = files.signature(path)
    return _parsed(path, signature) if signature else None


@lru_cache(maxsize=64)
def _parsed(path: PurePath, signature: Stat) -> dict[str, Any] | None:
    return read_record(path)
