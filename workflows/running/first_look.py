"""The plan of one video from its source and its name: what is known of both is not looked at again."""

from __future__ import annotations

from zsmoseg.remote.looks import one_look
from zsmoseg.stores import files, seen
from zsmoseg.stores.imports import Imports, imports
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import last_entry
from zsmoseg.video.probe import Excerpt, Probe, probe
from zsmoseg.video.sources import fingerprint as read_fingerprint
from zsmoseg.video.sources import stat_signature
from zsmoseg.workflows.imports.settling import settle
from zsmoseg.workflows.planning.plan import VideoPlan, plan_video
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.summary import settled
from zsmoseg.workflows.stages.cues.frames import STAGE


def make_plan(request: Request, store: Store, source: str, name: str, alone: bool) -> VideoPlan:
    """The plan of one video; ``alone``: the sources hold no other.

    Raises
    ------
    ZsmosegError
        See ``settle`` and ``plan_video``; the source cannot be read.
    """
    with one_look():
        return _planned(request, store, source, name, alone)


def _planned(request: Request, store: Store, source: str, name: str, alone: bool) -> VideoPlan:
    settings = request.settings
    signature, method = stat_signature(source), settings.video.fingerprint
    fingerprint = store.fingerprint_of(f"{method} {signature}", lambda: read_fingerprint(source, method))
    looked = _probe(store, source, signature, fingerprint, settings.video.parameters(Excerpt))
    video = store.video_id(name, fingerprint)
    folder = store.video(video).path
    with files.looking_at(folder, request.out / name):
        last = last_entry(store, video)
        now = seen.look(folder, last.keys) if last and last.seen else {}
        known = seen.known(last.seen, now, last.keys) if last else set()
        before = imports(store, video, last, anew=request.imports)
        settled_by = Imports(before.held) if request.imports else before
        chosen, brought = settle(settings, store, name, settled_by, alone)
        plan = plan_video(
            store,
            source,
            name,
            video,
            fingerprint,
            looked,
            chosen,
            brought,
            str(request.out / name),
            request.start_from,
            request.until,
            known,
            last.gone if last else set(),
        )
        plan.seen, plan.settled = now, settled(plan, settings)
        plan.imported = before.kinds if request.imports else {*before.held}
        return plan


def _probe(store: Store, source: str, signature: str, fingerprint: str, excerpt: Excerpt) -> Probe:
    """The probe of a source: the one known here if no file was touched since; opening a hundred images takes a while.

    One of another version of the stage ``frames`` may mean other frames, and does not count.
    """
    found = store.remembered(
        f"{STAGE.version} {excerpt} {signature}",
        lambda: {"fingerprint": fingerprint, "probe": probe(source, excerpt).to_json()},
    )
    return Probe.from_json(found["probe"])
