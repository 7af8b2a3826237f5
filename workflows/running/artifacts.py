"""The artifacts of a plan, around its jobs: laid out before the first one, sealed after the last."""

from __future__ import annotations

from typing import Any

from zsmoseg.settings import Settings
from zsmoseg.stores.beginning import begin
from zsmoseg.stores.checks import joined_problem, part_problem
from zsmoseg.stores.leases import lease, sweep
from zsmoseg.stores.location import Store
from zsmoseg.stores.sealing import seal
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.summary import write_summary


def prepare(store: Store, plan: VideoPlan) -> None:
    """Lay out the artifacts of a plan, and take back the records of what is asked for again.

    What is finished stays: another run may read it, or may have finished it since this plan was made.
    """
    store.describe_video(plan.video, plan.source, plan.fingerprint)
    for stage in plan.stages.values():
        if stage.artifact is None:
            continue
        chosen = stage.stage.chosen(stage.given)
        labels = {dim: list(text) for dim, text in stage.stage.labels(chosen).items()}
        description = {**stage.description, "fingerprint": plan.fingerprint, "labels": labels}
        if stage.stage.name == "frames":
            description["probe"] = plan.probe.to_json()
        with lease(stage.artifact.records / "begin.lease"):
            begin(stage.artifact, description, stage.parts, stage.stage.video_arrays(plan.probe, stage.given))
        if stage.again:
            stage.artifact.invalidate(stage.todo)
        if stage.artifact.parts != stage.parts:
            # another run began it meanwhile, in chunks of another length
            stage.parts = stage.artifact.parts
            stage.todo = [i for i in range(len(stage.parts)) if part_problem(stage.artifact, i)]
    outputs = {
        name: stage.description for name, stage in plan.stages.items() if stage.stage.output and stage.todo
    }
    if outputs:
        plan.output.claim(outputs)


def seal_video(plan: VideoPlan, settings: Settings) -> dict[str, Any] | None:
    """Seal what is whole and not sealed yet; the summary where the plan leaves files."""
    for stage in plan.stages.values():
        if stage.artifact is not None and stage.stage.leaves and joined_problem(stage.artifact):
            with lease(stage.artifact.records / "seal.lease"):
                if joined_problem(stage.artifact):
                    sweep(stage.artifact.records)
                    seal(stage.artifact, stage.stage.leaves, plan.probe.times, plan.probe.names)
    outputs = any(stage.stage.output for stage in plan.stages.values())
    return write_summary(plan, settings) if outputs else None
