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
└── StageError       a part of a stage failed; what was finished is kept
"""

from __future__ import annotations


class ZsmosegError(Exception):
    """Base of every error that is meant for users; commands print it as one line and exit with 2."""


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


class StageError(ZsmosegError):
    """A part of a stage failed; everything finished before it is kept."""
