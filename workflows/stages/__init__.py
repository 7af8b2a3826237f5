"""The stages in order: each reads only stages above it. A new stage is one file here and one line below.

Front ends differ only up to ``labels``: whatever proposes objects leaves the same ``objects`` and ``labels``,
and all behind reads nothing before them.
"""

from collections.abc import Mapping
from types import ModuleType

from zsmoseg.workflows.stage import Stage
from zsmoseg.workflows.stages import (
    affinity,
    depth,
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
)


def _all(*front: ModuleType) -> dict[str, Stage]:
    cues, core = (frames, flow, depth), (statistics, residuals, affinity, groups, masks, overlay)
    return {module.STAGE.name: module.STAGE for module in (*cues, *front, *core)}


FRONTS: Mapping[str, Mapping[str, Stage]] = {
    "embedded": _all(segments, tables, objects, labels),
    "imported": _all(proposals, imported_objects, imported_labels),
}
"""The stages by front end, the value of ``proposals.source``, and name."""


def names() -> list[str]:
    """Every name of a stage."""
    return list(dict.fromkeys(name for stages in FRONTS.values() for name in stages))


def readers(section: str) -> list[str]:
    """The stages that read a section of the settings."""
    found = (s.name for stages in FRONTS.values() for s in stages.values() if section in s.sections)
    return list(dict.fromkeys(found))
