"""The stages in order: each reads only stages above it. A new stage is one file here and one line below.

Front ends differ only up to ``labels``: whatever proposes objects leaves the same ``objects`` and ``labels``,
and all behind reads nothing before them.
"""

from collections.abc import Mapping

from zsmoseg.settings import Settings
from zsmoseg.workflows.stage import Stage
from zsmoseg.workflows.stages import (
    affinity,
    depth,
    epipolar,
    flow,
    frames,
    groups,
    imported_labels,
    imported_objects,
    labels,
    masks,
    objects,
    overlay,
    proposals,
    residuals,
    segments,
    statistics,
    tables,
    trajectories,
)

CUES = (frames.STAGE, flow.STAGE, depth.STAGE)
FRONT_ENDS = {
    "embedded": (segments.STAGE, tables.STAGE, objects.STAGE, labels.STAGE),
    "imported": (proposals.STAGE, imported_objects.STAGE, imported_labels.STAGE),
}
RESIDUALS = (statistics.STAGE, residuals.STAGE)
AFFINITIES = {
    "flow": (affinity.STAGE,),
    "epipolar": (trajectories.STAGE, epipolar.STAGE, affinity.WITH_EPIPOLAR),
}
ENDS = (groups.STAGE, masks.STAGE, overlay.STAGE)

GRAPHS: Mapping[str, Mapping[str, Stage]] = {
    f"{front}-{cues}": {
        stage.name: stage for stage in (*CUES, *FRONT_ENDS[front], *RESIDUALS, *AFFINITIES[cues], *ENDS)
    }
    for front in FRONT_ENDS
    for cues in AFFINITIES
}
"""Every graph that settings can ask for: its stages by name, in order."""


def graph_of(settings: Settings) -> str:
    """The name of the graph that settled settings ask for."""
    return f"{settings.proposals.source}-{'flow' if settings.affinity.cues == 'flow' else 'epipolar'}"


def names() -> list[str]:
    """Every name of a stage."""
    return list(dict.fromkeys(name for stages in GRAPHS.values() for name in stages))


def readers(section: str) -> list[str]:
    """The stages that read a section of the settings."""
    found = (s.name for stages in GRAPHS.values() for s in stages.values() if section in s.sections)
    return list(dict.fromkeys(found))
