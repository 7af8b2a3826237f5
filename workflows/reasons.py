"""Why a stage of a video will run, and how two of its keys differ."""

from __future__ import annotations

from pathlib import PurePath

from zsmoseg.errors import StoreError
from zsmoseg.settings import Settings
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import Entry, latest
from zsmoseg.workflows.planning.why import Description, why
from zsmoseg.workflows.running.first_look import make_plan
from zsmoseg.workflows.running.request import Request


def reasons(store: Store, video: str, stage: str, settings: Settings) -> list[str]:
    """Whether a stage would run with ``settings``, and what differs from what the latest run used.

    Raises
    ------
    StoreError
        There is no such video, or no such stage with these settings.
    ZsmosegError
        The source cannot be read any more.
    """
    entry = _entry(store, video)
    out = files.folder(entry.out).parent if entry.out else PurePath("zsmoseg-out")
    plan = make_plan(Request([entry.source], out, store.path, settings), store, entry.source, video, True)
    if stage not in plan.stages:
        raise StoreError(f"{video}: no stage {stage} with these settings; there are {', '.join(plan.stages)}")
    planned, before = plan.stages[stage], entry.keys.get(stage)
    parts = f"{len(planned.todo)} of {len(planned.parts)} parts to do"
    done = "not kept; made again where something reads it" if plan.lacks(planned) else "done, nothing to do"
    lines = [f"{stage}: {parts}: {planned.reason}" if planned.todo else f"{stage}: {done}"]
    if before is None:
        return [*lines, f"the latest run, {entry.run}, did not come to {stage}"]
    if before == planned.key:
        return [*lines, f"its key is that of the latest run: {planned.key}"]
    old = _described(store, entry, stage, before)
    if old is None:
        return [
            *lines,
            f"its key is {planned.key}, in the latest run {before}, of which nothing is left to compare",
        ]
    differ = why(
        old,
        planned.description,
        lambda name, key: _described(store, entry, name, key),
        lambda name, key: plan.stages[name].description if name in plan.stages else None,
    )
    return [
        *lines,
        f"its key is {planned.key}, in the latest run {before}:",
        *(f"  {line}" for line in differ),
    ]


def between(store: Store, video: str, stage: str, one: str, other: str) -> list[str]:
    """How two keys of a stage differ, from ``one`` to ``other``; their beginnings do.

    Raises
    ------
    StoreError
        There is no such video or key, or its record is damaged.
    """
    entry = _entry(store, video)
    old, new = (_by_front(store, entry, stage, front) for front in (one, other))

    def find(name: str, key: str) -> Description | None:
        return _described(store, entry, name, key)

    return why(old, new, find, find) or [f"{stage}: both are {new['key']}"]


def _entry(store: Store, video: str) -> Entry:
    found = latest(store).get(video)
    if found is None or not found.video:
        raise StoreError(f"{store.path}: no run came to {video!r}; zsmoseg status lists what is there")
    return found


def _described(store: Store, entry: Entry, stage: str, key: str) -> Description | None:
    return store.artifact(entry.video, stage, key).description


def _by_front(store: Store, entry: Entry, stage: str, front: str) -> Description:
    found = [a for a in store.video(entry.video).artifacts() if a.path.parent.name == stage]
    fitting = [artifact for artifact in found if artifact.path.name.startswith(front)]
    described = fitting[0].description if len(fitting) == 1 else None
    if described is None:
        there = ", ".join(sorted(artifact.path.name for artifact in found)) or "none"
        raise StoreError(
            f"{entry.name}: {len(fitting)} keys of {stage} begin with {front}; there are {there}"
        )
    return described
