"""``zsmoseg status``: from records alone, so it answers at once."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING

from zsmoseg.workflows.cli.common import store_option, store_path

if TYPE_CHECKING:
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.runs import Entry


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``status``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """A line a video as its latest run left it, and what is not finished."""
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store

    store = Store.open(store_path(options.store), create=False)
    with files.looking_at(store.path):
        _print(store)
    return 0


def _print(store: Store) -> None:
    from zsmoseg.stores.runs import latest

    found = latest(store)
    if not found:
        print(f"{store.path}: no runs yet")
    for name, entry in found.items():
        unfinished = ", ".join(_unfinished(store, entry))
        state = (
            f"failed: {entry.failure}"
            if entry.failure
            else f"unfinished: {unfinished}"
            if unfinished
            else "done"
            if entry.video
            else "not begun"
        )
        print(f"{name:<24} {entry.outcome:<11} {state}  -> {entry.out}")


def _unfinished(store: Store, entry: Entry) -> Iterator[str]:
    """Stages that are begun and not finished, with their parts."""
    for stage, key in entry.keys.items():
        artifact = store.artifact(entry.video, stage, key)
        if artifact.description is not None and artifact.done is None:
            done = sum(artifact.part(i) is not None for i in range(len(artifact.parts)))
            yield f"{stage} {done} of {len(artifact.parts)}"
