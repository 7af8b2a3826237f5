"""summary.json: what came out of one video, with which settings, and what it took."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from io import StringIO
from typing import Any, TypeVar

import numpy as np

from zsmoseg import __version__
from zsmoseg.grouping.decisions import Reason
from zsmoseg.settings import Settings
from zsmoseg.stores import files
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.artifact import Artifact
from zsmoseg.stores.output import LIST, STATES, SUMMARY
from zsmoseg.stores.records import as_json, read_json
from zsmoseg.stores.seen import VIDEO
from zsmoseg.workflows.object_numbers import objects, objects_of_pieces
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.affinity import Affinity
from zsmoseg.workflows.stages.motion.groups import Groups
from zsmoseg.workflows.stages.proposed.objects import object_names
from zsmoseg.workflows.warned import warnings_of

T = TypeVar("T", bound=Arrays)


def settled(plan: VideoPlan, settings: Settings) -> dict[str, Any] | None:
    """The summary of a video for which nothing is to be done, written or cleared, as two listings say; empty without files.

    None where somebody has to look closer.
    """
    stages = plan.stages.values()
    artifacts = {(stage.stage.name, stage.key) for stage in stages if stage.artifact is not None}
    if plan.todo or not {*artifacts, (VIDEO, "")} <= plan.known:
        return None
    if not any(stage.stage.output for stage in stages):
        return {}
    kept = _kept(plan, settings)
    listed = files.listing(plan.output.path).keys()
    return kept if listed == {*plan.output.files, LIST} and not plan.output.changed else None


def write_summary(plan: VideoPlan, settings: Settings) -> dict[str, Any]:
    """Describe a finished video in its output folder, and clear the folder of what an older run left there.

    Raises
    ------
    OutputError
        A file that the run left there is gone by now.
    """
    plan.output.refuse_gaps(plan.files)
    kept = _kept(plan, settings)
    if kept is not None:
        plan.output.remove_others([*plan.files, SUMMARY, STATES])
        return kept
    summary = summarise(plan, settings)
    text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    contents = {SUMMARY: text.encode(), STATES: states(plan).encode()}
    plan.output.finish(contents, plan.stages["groups"].key, plan.files)
    return summary


def _kept(plan: VideoPlan, settings: Settings) -> dict[str, Any] | None:
    """The summary that is there, if it is of just this and nothing is to be cleared; reads no array.

    What was computed again is described again: under the same keys it may be another result, by other versions of libraries.
    """
    if any(stage.reason != "done" for stage in plan.stages.values() if not stage.stage.output):
        return None
    names = [SUMMARY, STATES]
    if plan.output.files.keys() - {*plan.files, *names} or plan.output.problem(
        names, plan.stages["groups"].key
    ):
        return None
    found = read_json(plan.output.path / SUMMARY) or {}
    about = as_json(_about(plan, settings))
    return found if all(found.get(name) == value for name, value in about.items()) else None


def _about(plan: VideoPlan, settings: Settings) -> dict[str, Any]:
    """What tells one summary from another without a look at the arrays."""
    return {
        "zsmoseg": __version__,
        "source": plan.source,
        "fingerprint": plan.fingerprint,
        "frames": len(plan.probe.times),
        "size": [plan.probe.width, plan.probe.height],
        "notes": list(plan.notes),
        "settings": settings.flat(),
        "keys": plan.keys,
    }


def states(plan: VideoPlan) -> str:
    """CSV, a row for every piece of an object at every frame that shows it: whether it moves, and by what margin.

    The margin is the logarithm of its own odds against the static world (cost over what is tolerated), empty where it is unknown; what
    was torn off a mover moves when that does, whatever its margin.
    """
    labels, groups, out = _read(plan, "labels", Labels), _read(plan, "groups", Groups), StringIO()
    rows, of = csv.writer(out, lineterminator="\n"), objects_of_pieces(groups)
    rows.writerow(["frame", "name", "seconds", "object", "piece", "group", "moving", "margin"])
    for state in groups.blocks():
        if not state.has("moving"):
            continue
        seen = labels.of(state.start, state.stop)
        for frame, area in enumerate(seen.area, start=state.start):
            for n in seen.object[area > 0]:
                if n:
                    local = int(np.searchsorted(state.object, n))
                    moving, margin = (x[frame - state.start, local] for x in (state.moving, state.margin))
                    about = [of[n], n, groups.group[n], int(moving)]
                    when = [frame, plan.probe.names[frame], f"{plan.probe.times[frame]:.4f}"]
                    rows.writerow([*when, *about, f"{margin:.3f}" if np.isfinite(margin) else ""])
    return out.getvalue()


def _read(plan: VideoPlan, stage: str, kind: type[T]) -> T:
    """What a stage of a finished video left."""
    artifact = plan.stages[stage].artifact
    assert artifact is not None
    return kind.read(artifact)


def summarise(plan: VideoPlan, settings: Settings) -> dict[str, Any]:
    """Objects, groups, evidence, warnings, settings, keys, seconds and memory per stage."""
    artifact = plan.stages["groups"].artifact
    assert artifact is not None
    record = artifact.part(0)
    assert record is not None
    found = Groups.read(artifact)
    group, area = found.group, found.area
    evidence = list(_evidence(plan, found))
    return {
        **_about(plan, settings),
        "objects": len(evidence),
        "groups": len(np.unique(np.append(group, 0))),
        "moving_groups": len(np.unique(group[group > 0])),
        "moving_pixels_percent": _share(area, group, plan),
        "warnings": warnings_of(record.facts["warnings"], artifact, _proposed(plan)),
        "evidence": evidence,
        "stages": {
            name: _cost(plan, name)
            for name, stage in plan.stages.items()
            if stage.artifact is not None and not plan.lacks(stage)
        },
    }


def _proposed(plan: VideoPlan) -> Artifact | None:
    """The objects, where masks are proposed."""
    return plan.stages["objects"].artifact if "proposals" in plan.stages else None


def _evidence(plan: VideoPlan, found: Groups) -> Iterator[dict[str, Any]]:
    """A record an object, with what is known of the piece of its number; under it the pieces that joined it."""
    described = plan.stages["objects"].artifact
    names = object_names(described) if described is not None and "detections" in plan.stages else []
    seen = _read(plan, "affinity", Affinity).evidence(len(found.group))

    def proof(n: int) -> dict[str, Any]:
        return {
            "excess_px": _known(found.excess[n]),
            "tolerance_px": _known(found.tolerance[n]),
            "affinity_with_world": _known(found.world[n]),
            "geometry": str(seen["geometry"][n]),
            **{name: _known(values[n]) for name, values in seen.items() if values.dtype.kind == "f"},
            "decided_by": Reason(int(found.reason[n])).name.lower(),
        }

    def size(frames: int, moving: int, area: int) -> dict[str, int]:
        return {"frames": int(frames), "frames_moving": int(moving), "pixels": int(area)}

    for thing in objects(found, _read(plan, "labels", Labels)):
        if thing.number:
            yield {
                "object": thing.number,
                **({"category": names[thing.number]} if names else {}),
                "group": int(found.group[thing.number]),
                **size(thing.frames, thing.frames_moving, thing.area),
                **proof(thing.number),
                "joined": [
                    {"piece": n, **size(found.frames[n], found.frames_moving[n], found.area[n]), **proof(n)}
                    for n in thing.pieces[1:]
                ],
            }


def _known(value: float) -> float | None:
    """Four digits; None where it is unknown."""
    return round(float(value), 4) if np.isfinite(value) else None


def _share(area: Any, group: Any, plan: VideoPlan) -> float:
    """Percent of all pixels that belong to moving groups; areas are pixels of the displayed size."""
    total = len(plan.probe.times) * plan.probe.width * plan.probe.height
    return round(100.0 * float(area[group > 0].sum()) / total, 4)


def _cost(plan: VideoPlan, name: str) -> dict[str, float]:
    artifact = plan.stages[name].artifact
    assert artifact is not None
    records = [r for r in map(artifact.part, range(len(artifact.parts))) if r is not None]
    warm_up = sum(r.facts.get("warm_up", 0.0) for r in records)
    return {
        "seconds": round(sum(r.facts.get("seconds", 0.0) for r in records), 3),
        **({"warm_up_seconds": round(warm_up, 3)} if warm_up else {}),
        "megabytes": round(sum(f["size"] for r in records for f in r.files.values()) / 1e6, 3),
    }
