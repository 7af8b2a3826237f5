"""``zsmoseg gc``: what no run reaches, or none of the settings given; removed with ``--yes``."""

from __future__ import annotations

import argparse
from pathlib import Path

from zsmoseg.workflows.cli.common import store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``gc``."""
    store_option(parser)
    parser.add_argument(
        "--forget", action="append", default=[], metavar="RUN", help="drop a run (see zsmoseg runs)"
    )
    parser.add_argument(
        "--config",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="keep only what these settings (TOML) reach, of every video; may be given more than once, with --preset too",
    )
    parser.add_argument(
        "--preset", action="append", default=[], metavar="NAME", help="the same with a preset"
    )
    parser.add_argument("--yes", action="store_true", help="remove; without it, nothing is changed")


def main(options: argparse.Namespace) -> int:
    """Show what would go; remove it if told so."""
    from zsmoseg.settings import resolve
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.upkeep import garbage, remove_garbage
    from zsmoseg.workflows.reach import reached

    configurations = [resolve(preset) for preset in options.preset]
    configurations += [resolve(config=path) for path in options.config]
    store = Store.open(store_path(options.store), create=False)
    keep, unknown = reached(store, configurations) if configurations else (None, [])
    with files.looking_at(store.path):
        found = garbage(store, options.forget, keep)
    for line in [*unknown, *found.paths]:
        print(line)
    print(f"{len(found.paths)} artifacts and leftovers, {found.size / 1e6:.1f} MB")
    if not found.paths and not options.forget:
        return 0
    if not options.yes:
        print("nothing removed; --yes removes this")
        return 0
    remove_garbage(store, found, options.forget)
    print("removed")
    return 0
