"""``zsmoseg gc``: what no run reaches, or none of the settings given; removed with ``--yes``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from zsmoseg.workflows.cli.common import store_option, store_path

LONGEST = 9999
"""Hours, days or weeks of an age."""


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
    parser.add_argument(
        "--older-than", type=age, metavar="AGE", help="drop the runs begun longer ago: 30d, 12h or 2w"
    )
    parser.add_argument(
        "--keep-cues",
        type=whole,
        metavar="N",
        help="of all runs but the latest N keep what results are read from only, no flow and other cues",
    )
    parser.add_argument("--yes", action="store_true", help="remove; without it, nothing is changed")


def main(options: argparse.Namespace) -> int:
    """Show what would go; remove it if told so."""
    from zsmoseg.settings import resolve
    from zsmoseg.stores import files
    from zsmoseg.stores.location import Store
    from zsmoseg.stores.runs import begun_before, run_ids
    from zsmoseg.stores.upkeep import EVERYTHING, Thin, freed, garbage, remove_garbage
    from zsmoseg.workflows.reach import reached
    from zsmoseg.workflows.running.request import RESULTS
    from zsmoseg.workflows.wording import counted, megabytes

    configurations = [resolve(preset) for preset in options.preset]
    configurations += [resolve(config=path) for path in options.config]
    store = Store.open(store_path(options.store), create=False)
    keep, unknown = reached(store, configurations) if configurations else (None, [])
    aged, thin = list[str](), EVERYTHING
    if options.older_than is not None:
        aged = begun_before(store, datetime.now(UTC) - options.older_than)
    if options.keep_cues is not None:
        thin = Thin(frozenset(older(run_ids(store), options.keep_cues)), RESULTS)
    with files.looking_at(store.path):
        found = garbage(store, options.forget, keep, thin, aged)
    forget = [*options.forget, *aged]
    kept = [
        f"{path}: is kept, and so is what was imported; remove it to have that go too" for path in found.kept
    ]
    for line in [*unknown, *kept, *found.paths]:
        print(line)
    print(f"{counted(len(found.paths), 'artifact')} and leftovers, {found.size / 1e6:.1f} MB")
    if not (found.paths or forget or found.thinner):
        for run, size in freed(store).items():
            print(f"  --forget {run} would free {megabytes(size)}")
        return 0
    if not options.yes:
        print("nothing removed; --yes removes this")
        return 0
    remove_garbage(store, found, forget)
    print("removed")
    return 0


def older(runs: Sequence[str], latest: int) -> Sequence[str]:
    """All but the latest so many."""
    return runs[: max(len(runs) - latest, 0)]


def whole(text: str) -> int:
    """An integer of at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text}: expected 0 or more")
    return int(text)


def age(text: str) -> timedelta:
    """``30d``, ``12h``, ``2w``."""
    units = {"h": timedelta(hours=1), "d": timedelta(days=1), "w": timedelta(weeks=1)}
    if not (text[:-1].isdecimal() and text[-1:] in units):
        raise argparse.ArgumentTypeError(f"{text}: expected a number of hours, days or weeks: 12h, 30d, 2w")
    number = int(text[:-1])
    if number > LONGEST:
        raise argparse.ArgumentTypeError(f"{text}: expected at most {LONGEST}")
    return number * units[text[-1]]
