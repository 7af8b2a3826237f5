"""``zsmoseg status``: from records alone, so it answers at once."""

from __future__ import annotations

import argparse

from zsmoseg.workflows.cli.common import store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``status``."""
    store_option(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object a line, for programs")


def main(options: argparse.Namespace) -> int:
    """A line a video as its latest run left it, and what is not finished."""
    import json

    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.standing import in_words, standing

    store = Store.open(store_path(options.store), create=False)
    empty = True
    for about in standing(store):
        empty = False
        print(json.dumps(about) if options.json else in_words(about))
    if empty and not options.json:
        print(f"{store.path}: no runs yet")
    return 0
