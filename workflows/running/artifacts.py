"""The artifacts of a plan, around its jobs: laid out before the first one, sealed after the last."""

from __future__ import annotations

from typing import Any

from zsmoseg.settings import Settings
from zsmoseg.stores import files
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.beginning import begin
from zsmoseg.stores.checks import part_problem
from zsmoseg.stores.leases import lease, sweep
from zsmoseg.stores.location import Store
from zsmoseg.stores.sealing import seal_once
from zsmoseg.workflows.planning.plan import StagePlan, VideoPlan
from zsmoseg.workflows.running.summary import write_summary
from zsmoseg.workflows.stage import first_record


def prepare(store: Store, plan: VideoPlan) -> None:
    """Lay out the artifacts of a plan, and take back the records of what is asked for again.

    What is finished stays: another run may read it, or may have finished it since this plan was made.
    """
    store.video(plan.video).keep_probe(plan.stages["frames"].key, plan.probe.to_json())
    for stage in plan.stages.values():
        if stage.artifact is None or plan.lacks(stage):
            continue
        if not stage.packed:
            _begin(stage, stage.artifact, plan)
        if stage.again:
            stage.artifact.invalidate(stage.todo)
    outputs = {
        name: stage.description for name, stage in plan.stages.items() if stage.stage.output and stage.todo
    }
    if outputs:
        plan.output.claim(outputs)


def _begin(stage: StagePlan, artifact: Artifact, plan: VideoPlan) -> None:
    content = first_record(stage.stage, stage.description, plan.fingerprint, plan.probe, stage.parts)
    with lease(artifact.lease_path("begin")), files.glancing_at(artifact.path.parent):
        begin(artifact, content)
        if artifact.parts != stage.parts:
            # another run began it meanwhile, in chunks of another length
            stage.parts = artifact.parts
            stage.todo = [i for i in range(len(stage.parts)) if part_problem(artifact, i)]


def seal_video(plan: VideoPlan, settings: Settings) -> dict[str, Any] | None:
    """Seal what the task of the last part has not sealed; the summary where the plan leaves files."""
    for stage in plan.stages.values():
        if stage.artifact is not None and not stage.packed and stage.stage.leaves and not plan.lacks(stage):
            seal_once(stage.artifact, stage.stage.leaves, plan.probe.times, plan.probe.names)
    frames = plan.stages["frames"].artifact
    assert frames is not None
    sweep(frames.path.parent.parent)
    outputs = any(stage.stage.output for stage in plan.stages.values())
    return write_summary(plan, settings) if outputs else None
