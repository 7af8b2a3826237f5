"""What users can be told: one tree, each message one line that says what was wrong and what to do.

ZsmosegError
├── SettingsError    a setting, preset or option: unknown, wrong type, out of range
├── VideoError       a source: missing, not a video, damaged, too short, frames of different size
├── FormatError      a file of masks, flow, depth or tracks: other size, other names, out of range, damaged
├── DatasetError     truth to compare with: no known layout, frames or sequences missing
├── ModelError       a model: missing, damaged, of another digest, graph and contract differ
├── NetworkError     a run of a network: numbers that are not finite, no memory
├── StoreError       a store: not one, of a newer version, damaged, of another source
├── OutputError      an output folder: made by something else or from another source
├── SpaceError       the disk is full or too small for the plan
├── AccessError      the system refused: no permission, gone meanwhile, no name for a file, nested too deep
├── ClusterError     a Dask cluster: nothing answers, no workers, workers that cannot do the work
└── StageError       a part of a stage failed; what was finished is kept
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager

from zsmoseg.remote.refusals import in_words as remote_in_words
from zsmoseg.remote.refusals import is_remote_error


class ZsmosegError(Exception):
    """Base of every error that is meant for users; commands print it as one line and exit with 2."""

    def __str__(self) -> str:
        """One line, whatever libraries and names had to say in it."""
        return " ".join(line.strip() for line in super().__str__().splitlines())


class SettingsError(ZsmosegError):
    """A setting, preset or option is unknown, of the wrong type or out of range."""


class VideoError(ZsmosegError):
    """A source cannot be read as a video."""


class FormatError(ZsmosegError):
    """A file of masks, flow, depth or tracks cannot be used."""


class DatasetError(ZsmosegError):
    """A dataset cannot be used: no known layout, frames or sequences missing."""


class ModelError(ZsmosegError):
    """A model cannot be used: missing, damaged, of another digest than it should be, graph and contract differ."""


class NetworkError(ZsmosegError):
    """A network ran and what came out cannot be used, or it ran out of memory."""


class StoreError(ZsmosegError):
    """A store cannot be used: not a store, of a newer version, damaged."""


class OutputError(ZsmosegError):
    """An output folder cannot be used: made by something else, or from another source."""


class SpaceError(ZsmosegError):
    """The disk is full, or too small for what is planned."""


class AccessError(ZsmosegError):
    """The system refused a file: no permission, gone meanwhile, a name that cannot be, nested too deep."""


class ClusterError(ZsmosegError):
    """A Dask cluster cannot be used: nothing answers, no workers are left, or they cannot do the work."""


class StageError(ZsmosegError):
    """A part of a stage failed; everything finished before it is kept."""


UNFINISHED = re.compile(r"(?<=.)[/\\]\.[^/\\]*[0-9a-f]{32}\.tmp$")
"""What files are called while they are written: the folder says more."""


def in_words(error: BaseException) -> str | None:
    """What the system raised about somebody's file, in one line; None where it is an error of ours."""
    if is_remote_error(error):
        return remote_in_words(error)[1]
    if isinstance(error, OSError):
        named = [
            UNFINISHED.sub("", str(name)) for name in (error.filename, error.filename2) if name is not None
        ]
        what = error.strerror or str(error) or type(error).__name__
        return " ".join(f"{' to '.join(named)}{': ' if named else ''}{what}".split())
    if isinstance(error, UnicodeError):
        return f"text or a name in another encoding than UTF-8 ({' '.join(str(error).split())})"
    if isinstance(error, RecursionError):
        return "is nested too deep to be read"
    if isinstance(error, ValueError) and "null byte" in str(error):
        return "a name with a null byte, which no file can have"
    return None


@contextmanager
def system_errors_in_words() -> Iterator[None]:
    """Turn what the system raises about files into an ``AccessError``; errors of ours pass as they are."""
    try:
        yield
    except (OSError, ValueError, RecursionError) as error:
        words = in_words(error)
        if words is None or isinstance(error, BrokenPipeError):
            raise
        raise AccessError(f"{words}; mend that and run the same command again") from error


def stops_all(error: BaseException | None) -> bool:
    """Whether no other video would fare better: the disk is full or read-only."""
    if isinstance(error, SpaceError):
        return True
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
        return True
    return error is not None and error.__cause__ is not None and stops_all(error.__cause__)
