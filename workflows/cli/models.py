"""``zsmoseg models``: which networks there are, and how they get here."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WORDS = {
    "list": "all networks: task, size, licence, whether they are here",
    "fetch": "download networks of the registry; whatever arrives is checked before it is used",
    "verify": "read every file of the networks that are here; exits with 1 when one is not as its contract says",
    "add": "take a network of your own: a folder with contract.toml and ONNX files (docs/models.md)",
    "export": "make a network from a checkpoint that you have; needs pip install 'zsmoseg[export]'",
}


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``models``."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    sub = {name: actions.add_parser(name, help=what, description=what) for name, what in WORDS.items()}
    sub["list"].add_argument("--json", action="store_true", help="for programs")
    fetch = sub["fetch"]
    fetch.add_argument("names", nargs="*", metavar="NAME", help="models of the registry")
    fetch.add_argument("--preset", help="those that a preset needs")
    fetch.add_argument(
        "--from",
        dest="source",
        metavar="FOLDER_OR_URL",
        help="take the files from there, by name; the same sha256 hold (machines without internet)",
    )
    fetch.add_argument(
        "--accept",
        action="append",
        default=[],
        metavar="SHA256",
        help="trust a file of this digest where the registry knows none",
    )
    sub["verify"].add_argument("names", nargs="*", metavar="NAME", help="only these")
    sub["add"].add_argument("path", type=Path, help="the folder")
    sub["add"].add_argument("--name", help="the name it gets (default: that of its contract)")
    sub["export"].add_argument("name", metavar="NAME", help="a model of the registry")
    sub["export"].add_argument("checkpoint", type=Path, help="the checkpoint of its authors")
    sub["export"].add_argument(
        "-o", "--to", type=Path, metavar="FOLDER", help="the folder to make (default: among the models)"
    )


def main(options: argparse.Namespace) -> int:
    """Do what is asked; 1 if ``verify`` found something."""
    return int(ACTIONS[options.action](options))


def _list(options: argparse.Namespace) -> int:
    from zsmoseg.workflows.models.listing import as_json, rows
    from zsmoseg.workflows.models.place import models_folder

    found = rows()
    if options.json:
        print(as_json(found))
        return 0
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for title in ("name", "task", "size", "licence", "state"):
        table.add_column(title, justify="right" if title == "size" else "left", overflow="fold")
    for row in found:
        table.add_row(
            row.name,
            row.task,
            row.size,
            row.licence,
            row.state,
            style="bold" if row.state == "present" else "",
        )
    Console(width=None if sys.stdout.isatty() else 200, highlight=False, markup=False).print(table)
    print(f"models lie in {models_folder()} (ZSMOSEG_MODELS sets another folder)")
    return 0


def _fetch(options: argparse.Namespace) -> int:
    from zsmoseg.errors import ModelError, SettingsError
    from zsmoseg.workflows.models.needed import preset_models

    names = [*options.names, *(preset_models(options.preset) if options.preset else [])]
    if options.preset and not names:
        print(f"preset {options.preset} needs no networks")
    elif not names:
        raise SettingsError("say which models, or --preset NAME; zsmoseg models list shows them")
    failed = 0
    for name in dict.fromkeys(names):
        try:
            print(f"{name}: {_fetch_one(name, options.source, options.accept)}")
        except ModelError as error:  # the others are fetched all the same
            print(f"zsmoseg: {error}", file=sys.stderr)
            failed += 1
    return 2 if failed else 0


def _fetch_one(name: str, source: str | None, accept: list[str]) -> Path:
    """Fetch a model; on a terminal, ask for the digests that nobody states."""
    from zsmoseg.workflows.models.fetching import UnknownDigests, fetch

    with _progress() as watch:
        try:
            return fetch(name, source, accept, watch)
        except UnknownDigests as error:
            if not sys.stdin.isatty():
                raise
            asked = error
    for file, digest in asked.found.items():
        print(f"{file}: sha256 {digest}, which no publisher states")
    if input("trust what arrived? [y/N] ").strip().lower() not in ("y", "yes"):
        raise asked
    with _progress() as watch:
        return fetch(name, source, [*accept, *asked.found.values()], watch)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int | None], None]]:
    """A bar a file on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda file, done, whole: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    bars: dict[str, Any] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:

        def watch(file: str, done: int, whole: int | None) -> None:
            if file not in bars:
                bars[file] = progress.add_task(file, total=whole)
            progress.update(bars[file], completed=done, total=whole)

        yield watch


def _verify(options: argparse.Namespace) -> int:
    from zsmoseg.workflows.models.checking import findings
    from zsmoseg.workflows.models.place import cached_names, find_model, models_folder

    names = options.names or cached_names()
    found = [line for name in names for line in findings(find_model(name))]
    for line in found:
        print(line)
    if found:
        print(
            f"{len(found)} problem{'' if len(found) == 1 else 's'}; zsmoseg models fetch NAME gets again what is damaged"
        )
    else:
        print(f"{models_folder()}: {len(names)} models, every file is as its contract says")
    return 1 if found else 0


def _add(options: argparse.Namespace) -> int:
    from zsmoseg.workflows.models.adding import add

    place, filled = add(options.path, options.name)
    for file, digest in filled.items():
        print(f"{file}: sha256 {digest} written into the contract")
    print(f"{place.name}: {place}")
    return 0


def _export(options: argparse.Namespace) -> int:
    from zsmoseg.workflows.models.making import make

    place = make(options.name, options.checkpoint, options.to)
    print(f"{place.name}: {place}")
    return 0


ACTIONS = {"list": _list, "fetch": _fetch, "verify": _verify, "add": _add, "export": _export}
