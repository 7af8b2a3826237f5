"""Every setting: default, unit, range and meaning; presets; TOML.

A section is read by the stages that declare it (``workflows/stages``) and by nothing else. Names are
dotted, ``flow.stride``, and the same in ``--set``, in TOML, in Python and in the store. Lengths are
pixels of the working grid (``frames.width`` wide) unless a name says otherwise.
"""

from zsmoseg.settings.grouping import Affinity, Groups, Motion, Statistics, Trajectories
from zsmoseg.settings.inputs import Depth, Flow, Frames, Ignore, Video
from zsmoseg.settings.networks import Linking, Looks, Networks, Selection, Tags, Tracking
from zsmoseg.settings.outputs import Chunk, Masks, Overlay
from zsmoseg.settings.proposals import Labels, Objects, Proposals, Segments
from zsmoseg.settings.resolving import PRESETS, parse_override, resolve
from zsmoseg.settings.section import Section
from zsmoseg.settings.tree import Settings, defaults
from zsmoseg.settings.words import describe

__all__ = [
    "PRESETS",
    "Affinity",
    "Chunk",
    "Depth",
    "Flow",
    "Frames",
    "Groups",
    "Ignore",
    "Labels",
    "Linking",
    "Looks",
    "Masks",
    "Motion",
    "Networks",
    "Objects",
    "Overlay",
    "Proposals",
    "Section",
    "Segments",
    "Selection",
    "Settings",
    "Statistics",
    "Tags",
    "Tracking",
    "Trajectories",
    "Video",
    "defaults",
    "describe",
    "parse_override",
    "resolve",
]
