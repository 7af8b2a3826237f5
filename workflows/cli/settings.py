"""``zsmoseg settings``."""

from __future__ import annotations

import argparse


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``settings``."""
    parser.add_argument("name", nargs="?", default="", help="only those whose name contains this")


def main(options: argparse.Namespace) -> int:
    """Print the table."""
    from rich.console import Console
    from rich.table import Table

    from zsmoseg.settings import defaults, describe
    from zsmoseg.workflows.stages import STAGES

    table = Table("setting", "default", "unit", "allowed", "stages that read it", "meaning", box=None, pad_edge=False)
    for name in defaults():
        if options.name in name:
            about = describe(name)
            readers = ", ".join(s.name for s in STAGES.values() if name.split(".")[0] in s.sections) or "-"
            row = about["name"], about["default"], about["unit"], about["allowed"], readers, about["meaning"]
            table.add_row(*map(_plain, row))
    Console(highlight=False).print(table)
    return 0


def _plain(text: str) -> str:
    return text.replace("[", r"\[")
