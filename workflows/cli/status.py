"""``zsmoseg status``: from records alone, so it answers at once."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from zsmoseg.workflows.cli.common import store_option, store_path

if TYPE_CHECKING:
    from zsmoseg.stores.location import Store


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``status``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """A line a video of the latest runs, and what is not finished."""
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store

    store = Store.open(store_path(options.store), create=False)
    with files.looking_at(store.path):
        _print(store)
    return 0


def _print(store: Store) -> None:
    from zsmoseg.stores.runs import list_runs

    latest = {name: run for run in list_runs(store) for name in run["videos"]}
    if not latest:
        print(f"{store.path}: no runs yet")
    for name, run in latest.items():
        entry = run["videos"][name]
        states = []
        for stage, key in entry["keys"].items():
            artifact = store.artifact(entry["video"], stage, key)
            if artifact.description is None or artifact.done is not None:
                continue
            done = sum(artifact.part(i) is not None for i in range(len(artifact.parts)))
            states.append(f"{stage} {done} of {len(artifact.parts)}")
        failure = run.get("failures", {}).get(name)
        state = f"failed: {failure}" if failure else "unfinished: " + ", ".join(states) if states else "done"
        print(f"{name:<24} {run['outcome']:<11} {state}  -> {entry['out']}")
