"""``zsmoseg verify``: whether every file of a store and of what its runs left for users is as it was written."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import store_option, store_path, told_damages


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``verify``."""
    store_option(parser)


def main(options: argparse.Namespace) -> int:
    """Name every file that is missing, of wrong size or of wrong content; 1 if there is one. Nothing is changed."""
    from zsmoseg.stores.location import Store

    damages = told_damages(Store.open(store_path(options.store), create=False))
    if damages:
        print(
            f"{len(damages)} problems; zsmoseg repair --yes, then the same zsmoseg run command again, mends them; zsmoseg gc "
            "removes those that no run reaches"
        )
    return 1 if damages else 0
