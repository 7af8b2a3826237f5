"""``zsmoseg runs``: what was run with a store, when, and how it ended."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import store_option, store_path

SHOWN = 12
"""Names of a run that are looked at for its line."""


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``runs``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """A line a run, the latest last."""
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.runs import list_runs

    for record in list_runs(Store.open(store_path(options.store), create=False)):
        names = record["names"]
        shown = ", ".join(names[:SHOWN])
        print(f"{record['id']}  {record['outcome']:<11}  {len(names)} videos: {shown[:60]}")
    return 0
