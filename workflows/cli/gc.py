"""``zsmoseg gc``: remove what no run reaches, after asking."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import agreed, store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``gc``."""
    store_option(parser)
    parser.add_argument(
        "--forget", action="append", default=[], metavar="RUN", help="drop a run (see zsmoseg runs)"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask")


def main(options: argparse.Namespace) -> int:
    """Show what would go, ask, remove."""
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.upkeep import garbage, remove_garbage

    store = Store.open(store_path(options.store), create=False)
    with files.looking_at(store.path):
        found = garbage(store, options.forget)
    for path in found.paths:
        print(path)
    print(f"{len(found.paths)} artifacts and leftovers, {found.size / 1e6:.1f} MB")
    if not found.paths and not options.forget:
        return 0
    if not options.yes and not agreed("remove?"):
        print("nothing removed")
        return 0
    remove_garbage(store, found, options.forget)
    print("removed")
    return 0
