"""How each video of a store stands: from records and names of files alone, no array is read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from zsmoseg.stores import files
from zsmoseg.stores.location import Store
from zsmoseg.stores.runs import Entry, latest


def standing(store: Store) -> Iterator[dict[str, Any]]:
    """A record a video, as its latest run left it.

    Yields
    ------
    ``video`` (its name), ``run``, ``outcome`` (done, failed, running, interrupted), ``state`` (done, failed, unfinished, not
    begun), ``failure``, ``stages`` (of those that are not finished the parts that are written, and all), ``source``, ``out``.
    """
    with files.looking_at(store.path):
        for name, entry in latest(store).items():
            stages = dict(_unfinished(store, entry))
            begun = "done" if entry.video else "not begun"
            state = "failed" if entry.failure else "unfinished" if stages else begun
            yield {
                "video": name,
                "run": entry.run,
                "outcome": entry.outcome,
                "state": state,
                "failure": entry.failure,
                "stages": stages,
                "source": entry.source,
                "out": entry.out,
            }


def _unfinished(store: Store, entry: Entry) -> Iterator[tuple[str, list[int]]]:
    """Stages that are begun and not finished: their parts that are written, and all."""
    for stage, key in entry.keys.items():
        artifact = store.artifact(entry.video, stage, key)
        if not artifact.packed and artifact.description is not None and artifact.done is None:
            yield stage, [artifact.written, len(artifact.parts)]


def in_words(about: dict[str, Any]) -> str:
    """One line."""
    parts = ", ".join(f"{stage} {done} of {all_}" for stage, (done, all_) in about["stages"].items())
    words = {"failed": f"failed: {about['failure']}", "unfinished": f"unfinished: {parts}"}
    state = words.get(about["state"], about["state"])
    return f"{about['video']:<24} {about['outcome']:<11} {state}  -> {about['out']}"
