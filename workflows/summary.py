"""summary.json: what came out of one video, with which settings, and what it took."""

from __future__ import annotations

import csv
import json
from io import StringIO
from typing import Any

import numpy as np

from zsmoseg import __version__
from zsmoseg.settings import Settings
from zsmoseg.workflows.plan import VideoPlan
from zsmoseg.workflows.stages.masks import moving_objects, write_bytes

NAME = "summary.json"
STATES = "motion.csv"


def write_summary(plan: VideoPlan, settings: Settings) -> dict[str, Any]:
    """Describe a finished video in its output folder, and clear the folder of what an older run left there."""
    summary = summarise(plan, settings)
    text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    plan.output.claim({})
    for name, content in ((NAME, text), (STATES, states(plan))):
        plan.output.add(
            {name: write_bytes(plan.output.path / name, content.encode())}, plan.stages["groups"].key
        )
    plan.output.remove_others([*plan.files, NAME, STATES])
    return summary


def states(plan: VideoPlan) -> str:
    """CSV, a row for every object at every frame that shows it: whether it moves, and by what margin.

    The margin is ln(excess / threshold), empty where it is unknown.
    """
    groups, labels = plan.stages["groups"].artifact, plan.stages["labels"].artifact
    assert groups is not None
    assert labels is not None
    table, out = groups.read_table(0), StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["frame", "name", "seconds", "object", "instance", "group", "moving", "margin"])
    shots = [(int(shot.split("-")[1]), groups.read_table(0, shot)) for shot in groups.groups(0)]
    for part, (start, stop) in enumerate(labels.parts):
        seen = labels.read_table(part)
        for frame in range(start, stop):
            first, state = next(shot for shot in reversed(shots) if shot[0] <= frame)
            for n in seen["object"][seen["area"][frame - start] > 0]:
                if n:
                    local = int(np.searchsorted(state["object"], n))
                    moving, margin = (state[name][frame - first, local] for name in ("moving", "margin"))
                    about = [n, table["instance"][n], table["group"][n], int(moving)]
                    when = [frame, plan.probe.names[frame], f"{plan.probe.times[frame]:.4f}"]
                    rows.writerow([*when, *about, f"{margin:.3f}" if np.isfinite(margin) else ""])
    return out.getvalue()


def summarise(plan: VideoPlan, settings: Settings) -> dict[str, Any]:
    """Objects, groups, evidence, warnings, settings, keys, seconds and memory per stage."""
    groups = plan.stages["groups"].artifact
    assert groups is not None
    record = groups.part(0)
    assert record is not None
    table = groups.read_table(0)
    group, frames = table["group"], len(plan.probe.times)
    moving = moving_objects(groups, 0, frames, len(group))
    return {
        "zsmoseg": __version__,
        "source": plan.source,
        "fingerprint": plan.fingerprint,
        "frames": frames,
        "size": [plan.probe.width, plan.probe.height],
        "objects": int((table["area"][1:] > 0).sum()),
        "groups": len(np.unique(np.append(group, 0))),
        "moving_groups": len(np.unique(group[group > 0])),
        "moving_pixels_percent": _share(table["area"], group, plan),
        "warnings": record.facts["warnings"],
        "evidence": [
            {
                "object": int(n),
                "group": int(group[n]),
                "instance": int(table["instance"][n]),
                "frames": int(table["frames"][n]),
                "frames_moving": int(moving[:, n].sum()),
                "pixels": int(table["area"][n]),
                "excess_px": round(float(table["score"][n]), 4),
                "threshold_px": round(float(table["threshold"][n]), 4),
                "visibility": round(float(table["visibility"][n]), 4),
            }
            for n in np.flatnonzero(table["area"] > 0)
            if n > 0
        ],
        "settings": settings.flat(),
        "keys": {name: stage.key for name, stage in plan.stages.items()},
        "stages": {
            name: _cost(plan, name) for name, stage in plan.stages.items() if stage.artifact is not None
        },
    }


def _share(area: Any, group: Any, plan: VideoPlan) -> float:
    """Percent of all pixels that belong to moving groups; areas are pixels of the displayed size."""
    total = len(plan.probe.times) * plan.probe.width * plan.probe.height
    return round(100.0 * float(area[group > 0].sum()) / total, 4)


def _cost(plan: VideoPlan, name: str) -> dict[str, float]:
    artifact = plan.stages[name].artifact
    assert artifact is not None
    records = [r for r in map(artifact.part, range(len(artifact.parts))) if r is not None]
    return {
        "seconds": round(sum(r.facts.get("seconds", 0.0) for r in records), 3),
        "megabytes": round(sum(f["size"] for r in records for f in r.files.values()) / 1e6, 3),
    }
