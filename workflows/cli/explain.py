"""``zsmoseg explain VIDEO [STAGE]``: why each object was called moving or static; why a stage will run."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from zsmoseg.workflows.cli.common import store_option, store_path
from zsmoseg.workflows.cli.run import setting_options

if TYPE_CHECKING:
    from zsmoseg.workflows.result import Result


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``explain``."""
    parser.add_argument("video", help="name of a video in the store (see zsmoseg status)")
    parser.add_argument(
        "stage",
        nargs="?",
        help="instead of the objects: whether this stage would run with the settings given here, and why",
    )
    parser.add_argument(
        "--keys", nargs=2, metavar="KEY", help="with STAGE: how two keys of it differ (their beginnings do)"
    )
    setting_options(parser)
    store_option(parser)
    parser.add_argument(
        "--object",
        type=int,
        metavar="N",
        help="only this object (the value in objects/), or this piece of one",
    )
    parser.add_argument(
        "--pairs",
        action="store_true",
        help="with --object: every pair of frames, what it costs and what is tolerated",
    )
    parser.add_argument("--run", help="of this run instead of the latest (see zsmoseg runs)")


def main(options: argparse.Namespace) -> int:
    """Print the evidence.

    Raises
    ------
    StoreError
        There is no such object, or ``--pairs`` is asked for without one.
    """
    from zsmoseg.errors import StoreError
    from zsmoseg.workflows.explanation import details, each_pair
    from zsmoseg.workflows.result import open_store

    if options.stage:
        return _stage(options)
    if options.keys:
        raise StoreError("--keys compares two keys of one stage; name it after the video")
    if options.pairs and not options.object:
        raise StoreError("--pairs tells of one object; name it with --object N")

    result = open_store(store_path(options.store)).get(options.video, options.run)
    for line in _told(result, options.object):
        print(line)
    if options.object:
        for line in details(result, options.object):
            print(f"  {line}")
    if options.pairs:
        for line in each_pair(result, options.object):
            print(f"  {line}")
    return 0


def _told(result: Result, number: int | None) -> Iterator[str]:
    """The evidence for all objects, or for one, or for one piece of an object."""
    from zsmoseg.errors import StoreError
    from zsmoseg.workflows.sentences import of_object, of_piece
    from zsmoseg.workflows.warned import wholly_ignored

    pieces = {row["piece"]: row for row in result.pieces.to_dict("records") if row["piece"] > 0}
    things = [row for row in result.objects.to_dict("records") if row["object"] > 0]
    visible = float(_setting(result, "affinity", "visible"))
    chosen = [thing for thing in things if number in (None, thing["object"])]
    for thing in chosen:
        yield from of_object(thing, [pieces[n] for n in thing["pieces"]], visible)
    joined = [pieces[number]] if number in pieces and not chosen else []
    yield from (of_piece(piece, visible) for piece in joined)
    if number is None and not things:
        yield "nothing was proposed: there is no object"
    elif (
        number is not None
        and "proposals" in result.keys
        and number in wholly_ignored(result.artifact("objects"), result.groups.area)
    ):
        yield f"object {number}: lies wholly in what is ignored (--ignore), so it is left out"
    elif not chosen and not joined:
        there = ", ".join(str(thing["object"]) for thing in things) or "none"
        raise StoreError(f"{result.name} has no object {number}; there are {there}")


def _stage(options: argparse.Namespace) -> int:
    """Why a stage will run, or how two of its keys differ."""
    from zsmoseg.settings import resolve
    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.cli.run import overrides
    from zsmoseg.workflows.reasons import between, reasons

    store = Store.open(store_path(options.store), create=False)
    if options.keys:
        lines = between(store, options.video, options.stage, *options.keys)
    else:
        settings = resolve(options.preset, options.config, overrides(options))
        lines = reasons(store, options.video, options.stage, settings)
    for line in lines:
        print(line)
    return 0


def _setting(result: Result, stage: str, name: str) -> Any:
    """A setting that the artifact of a stage was made with."""
    return (result.artifact(stage).description or {})["settings"][stage][name]
