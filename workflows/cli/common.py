"""Options that several commands share."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from zsmoseg.remote.url import folder

if TYPE_CHECKING:
    from zsmoseg.stores.checks import Damage
    from zsmoseg.stores.location import Store

OUT = "zsmoseg-out"


def store_option(parser: argparse.ArgumentParser) -> None:
    """``--store``."""
    parser.add_argument(
        "--store",
        type=folder,
        default=None,
        help="the store, a folder or s3://bucket/name (default: $ZSMOSEG_STORE, or zsmoseg-store beside the output folder)",
    )


def store_path(given: PurePath | None, out: PurePath | None = None) -> PurePath:
    """The store that is meant."""
    if given is not None:
        return given
    if os.environ.get("ZSMOSEG_STORE"):
        return folder(os.environ["ZSMOSEG_STORE"])
    return (out or Path(OUT)).parent / "zsmoseg-store"


def told_damages(store: Store) -> list[Damage]:
    """What ``verify`` finds, a line each on the terminal, or that there is nothing."""
    from zsmoseg.stores import files
    from zsmoseg.stores.upkeep import verify

    with files.looking_at(store.path):
        damages = verify(store)
    for damage in damages:
        print(f"{damage.path}: {damage.what}")
    if not damages:
        print(f"{store.path}: every file is as it was written")
    return damages


def agreed(question: str) -> bool:
    """Whether the user says yes; without a terminal to ask at: no."""
    if not sys.stdin.isatty():
        print("give --yes to go on without being asked")
        return False
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
