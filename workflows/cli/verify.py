"""``zsmoseg verify``: whether every file of a store and of what its runs left for users is as it was written."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``verify``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """Name every file that is missing, of wrong size or of wrong content; 1 if there is one. Nothing is changed."""
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.upkeep import verify

    store = Store.open(store_path(options.store), create=False)
    with files.looking_at(store.path):
        damages = verify(store)
    for damage in damages:
        print(f"{damage.path}: {damage.what}")
    if damages:
        print(
            f"{len(damages)} problems; zsmoseg repair, then the same zsmoseg run command again, mends them; zsmoseg gc "
            "removes those that no run reaches"
        )
    else:
        print(f"{store.path}: every file is as it was written")
    return 1 if damages else 0
