"""Which artifacts given settings reach: for every video that a run came to, the keys that it would have now."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from zsmoseg.errors import ZsmosegError
from zsmoseg.settings import Settings
from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import Entry, latest
from zsmoseg.stores.upkeep import Place
from zsmoseg.workflows.running.first_look import make_plan
from zsmoseg.workflows.running.request import Request

LAST = "groups"
"""The last stage that the store keeps, in every graph."""


def reached(store: Store, configurations: Sequence[Settings]) -> tuple[set[Place], list[str]]:
    """What ``configurations`` reach of all videos, by the names that they had last.

    A video whose source cannot be read has no keys that could be known: all of it counts as reached.

    Returns
    -------
    found
        (video,) and (video, stage, key).
    unknown
        A line for each video that is kept for this reason.
    """
    found: set[Place] = set()
    unknown = []
    entries = [entry for entry in latest(store).values() if entry.video]
    for entry in entries:
        try:
            for settings in configurations:
                found |= _keys(store, entry, settings, len(entries) == 1)
        except (ZsmosegError, OSError) as error:
            unknown.append(f"{entry.name}: all of it is kept, its keys are not known: {error}")
            artifacts = store.video(entry.video).artifacts()
            found |= {(entry.video,), *(a.path.relative_to(store.path).parts for a in artifacts)}
    return found, unknown


def _keys(store: Store, entry: Entry, settings: Settings, alone: bool) -> set[Place]:
    out = files.folder(entry.out).parent if entry.out else PurePath("zsmoseg-out")
    request = Request([entry.source], out, store.path, settings, until=[LAST])
    plan = make_plan(request, store, entry.source, entry.name, alone)
    return {(plan.video,), *((plan.video, name, stage.key) for name, stage in plan.stages.items())}
