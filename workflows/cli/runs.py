"""``zsmoseg runs``: what was run with a store, when, and how it ended."""

from __future__ import annotations

import argparse
from typing import Any

from zsmoseg.workflows.cli.common import store_option, store_path

SHOWN = 12
"""Names of a run that are looked at for its line."""
LETTERS = 60
"""Of these that are shown."""


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``runs``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """A line a run, the latest last; under it the settings that are not the same in all of them."""
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.runs import list_runs
    from zsmoseg.workflows.planning.differences import shown
    from zsmoseg.workflows.wording import counted

    records = list_runs(Store.open(store_path(options.store), create=False))
    told = [{name: shown(value) for name, value in _settings(record).items()} for record in records]
    differ = {name for one in told for name in one if len({other.get(name) for other in told}) > 1}
    for record, settings in zip(records, told, strict=True):
        names = record["names"]
        videos = f"{counted(len(names), 'video')}: {', '.join(names[:SHOWN])[:LETTERS]}"
        print(f"{record['id']}  {record['outcome']:<11}  {videos}")
        line = ", ".join(f"{name}={value}" for name, value in settings.items() if name in differ)
        if line:
            print(f"  {line}")
    return 0


def _settings(record: dict[str, Any]) -> dict[str, Any]:
    """The settings of a run by dotted name; none where its record has none."""
    found = record.get("settings")
    return found if isinstance(found, dict) else {}
