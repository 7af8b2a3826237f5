"""Options that several commands share."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from zsmoseg.workflows.running.local_paths import local_folder

OUT = "zsmoseg-out"


def store_option(parser: argparse.ArgumentParser) -> None:
    """``--store``."""
    parser.add_argument(
        "--store",
        type=local_folder,
        default=None,
        help="the store (default: $ZSMOSEG_STORE, or zsmoseg-store beside the output folder)",
    )


def store_path(given: Path | None, out: Path | None = None) -> Path:
    """The store that is meant."""
    if given is not None:
        return given
    if os.environ.get("ZSMOSEG_STORE"):
        return local_folder(os.environ["ZSMOSEG_STORE"])
    return (out or Path(OUT)).parent / "zsmoseg-store"
