"""The stages in order: each reads only stages above it. A new stage is one file and its line here.

Front ends differ only up to ``labels``: whatever proposes objects leaves the same ``Objects`` and ``Labels``
(``front_end.py``), and all behind reads nothing before them.
"""

from collections.abc import Mapping
from typing import Any

from zsmoseg.settings import Settings
from zsmoseg.workflows.stage import Stage
from zsmoseg.workflows.stages.cues import depth, flow, frames
from zsmoseg.workflows.stages.embedded import features, segments
from zsmoseg.workflows.stages.embedded import labels as embedded_labels
from zsmoseg.workflows.stages.embedded import objects as embedded_objects
from zsmoseg.workflows.stages.motion import affinity, epipolar, groups, residuals, statistics, trajectories
from zsmoseg.workflows.stages.outputs import masks, overlay
from zsmoseg.workflows.stages.proposed import (
    detections,
    imported,
    selected,
    tags,
    tracked_labels,
    tracked_objects,
    tracks,
)
from zsmoseg.workflows.stages.proposed import labels as linked_labels
from zsmoseg.workflows.stages.proposed import objects as linked_objects

Graph = Mapping[str, Stage[Any, Any]]
"""Stages by name, in order."""

CUES = (frames.STAGE, flow.STAGE, depth.STAGE)
FRONT_ENDS = {
    "embedded": (segments.STAGE, features.STAGE, embedded_objects.STAGE, embedded_labels.STAGE),
    "imported": (imported.STAGE, linked_objects.STAGE, linked_labels.STAGE),
    "network": (
        tags.STAGE,
        detections.STAGE,
        selected.STAGE,
        tracks.STAGE,
        tracked_objects.STAGE,
        tracked_labels.STAGE,
    ),
}
RESIDUALS = (statistics.STAGE, residuals.STAGE)
AFFINITIES = {
    "flow": (affinity.STAGE,),
    "epipolar": (trajectories.STAGE, epipolar.STAGE, affinity.WITH_EPIPOLAR),
}
ENDS = (groups.STAGE, masks.STAGE, overlay.STAGE)

GRAPHS: dict[str, Graph] = {
    f"{front}-{cues}": {
        stage.name: stage for stage in (*CUES, *FRONT_ENDS[front], *RESIDUALS, *AFFINITIES[cues], *ENDS)
    }
    for front in FRONT_ENDS
    for cues in AFFINITIES
}
"""Every graph that settings can ask for."""


def graph_of(settings: Settings) -> str:
    """The name of the graph that settled settings ask for."""
    return f"{settings.proposals.source}-{'flow' if settings.affinity.cues == 'flow' else 'epipolar'}"


def names() -> list[str]:
    """Every name of a stage."""
    return list(dict.fromkeys(name for stages in GRAPHS.values() for name in stages))


def readers(section: str) -> list[str]:
    """The stages that read a section of the settings."""
    found = (s.name for stages in GRAPHS.values() for s in stages.values() if section in s.section_names)
    return list(dict.fromkeys(found))
