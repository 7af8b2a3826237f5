"""The stages in order: each reads only stages above it. A new stage is one file here and one line below."""

from zsmoseg.workflows.stage import Stage
from zsmoseg.workflows.stages import (
    affinity,
    depth,
    flow,
    frames,
    groups,
    labels,
    masks,
    objects,
    overlay,
    residuals,
    segments,
    statistics,
    tables,
)

STAGES: dict[str, Stage] = {
    module.STAGE.name: module.STAGE
    for module in (
        frames,
        flow,
        depth,
        segments,
        tables,
        objects,
        labels,
        statistics,
        residuals,
        affinity,
        groups,
        masks,
        overlay,
    )
}
