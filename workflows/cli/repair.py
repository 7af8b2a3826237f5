"""``zsmoseg repair``: takes back what ``zsmoseg verify`` finds damaged, so that the next run makes it again."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import agreed, store_option, store_path, told_damages


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``repair``."""
    store_option(parser)
    parser.add_argument("--yes", action="store_true", help="do not ask")


def main(options: argparse.Namespace) -> int:
    """Show what is damaged, ask, take back the records of it; the files stay until they are made again; 1 if the user did
    not agree.
    """
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.upkeep import take_back

    store = Store.open(store_path(options.store), create=False)
    damages = told_damages(store)
    if not damages:
        return 0
    if not options.yes and not agreed("take back?"):
        print("nothing changed")
        return 1
    take_back(store)
    print(
        f"{len(damages)} problems; the same zsmoseg run command again mends them, but for those that say what else to do"
    )
    return 0
