"""``zsmoseg explain VIDEO [STAGE]``: why each object was called moving or static; why a stage will run."""

from __future__ import annotations

import argparse
from math import isfinite
from typing import TYPE_CHECKING, Any

from zsmoseg.workflows.cli.common import store_option, store_path
from zsmoseg.workflows.cli.run import setting_options

if TYPE_CHECKING:
    from zsmoseg.workflows.result import Result

HALF = 0.5
"""Affinity with the world from which on an object is static."""


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
    parser.add_argument("--object", type=int, metavar="N", help="only this object (value in the labels)")
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
    table, moving = result.objects, result.groups.frames_moving
    rule = _setting(result, "groups", "rule")
    visible = _setting(result, "affinity", "visible")
    if options.object is not None and options.object not in table["object"].array:
        raise StoreError(
            f"{options.video} has no object {options.object}; there are "
            + (", ".join(map(str, table["object"][1:])) or "none")
        )
    rows = [row for row in table.to_dict("records") if row["object"] > 0]
    if options.object is not None:
        rows = [row for row in rows if row["object"] == options.object]
    if not rows:
        print("nothing was proposed: there is no object")
    for row in rows:
        print(sentence(row, int(moving[row["object"]]), rule, float(visible)))
    if options.object:
        for line in details(result, options.object):
            print(f"  {line}")
    if options.pairs:
        for line in each_pair(result, options.object):
            print(f"  {line}")
    return 0


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


def sentence(row: dict[str, Any], frames_moving: int, rule: str, visible: float) -> str:
    """The evidence for one object in words; ``rule`` and ``visible`` are the settings it was grouped with."""
    called = f" ({row['category']})" if row.get("category") else ""
    seen = f"object {row['object']}{called}: seen in {row['frames']} frames, {row['area']} pixels in all"
    answer = (
        f"group {row['group']}, instance {row['instance']}, moving in {frames_moving} frames"
        if row["group"]
        else "static"
    )
    if row["geometry"] == "obeys":
        evidence = (
            f"it stands on the ground beside it: {_measured(row)}: affinity {row['world']:.2f} with the world"
        )
    elif not isfinite(row["world"]):
        evidence = (
            f"the static world's motion explains its image as well as its own flow does (error ratio "
            f"{row['visibility']:.2f}, needed {visible:.2f})"
            if row["visibility"] < visible
            else "no pair of frames shows it against the static world"
            if row["counts"]
            else "beside what stands on the ground it counts for nothing"
        )
    else:
        evidence = (
            f"one motion for it and the static world costs {row['excess']:.3f} px more than one each, "
            f"{row['tolerance']:.3f} px are tolerated: affinity {row['world']:.2f} with the world, the border is 0.50"
        )
    return f"{seen}; {evidence}; {_geometry(row)}{_why(row, rule)}{answer}"


def _geometry(row: dict[str, Any]) -> str:
    """What the geometry of the static world says of an object that does not obey it."""
    if row["geometry"] in ("not asked", "obeys"):
        return ""
    if row["geometry"] == "breaks":
        return f"it does not stand on the ground beside it: {_measured(row)}; "
    return f"whether it stands on the ground beside it is not known: {row['geometry']}; "


def _measured(row: dict[str, Any]) -> str:
    """What was measured of its geometry."""
    found = ((name, row[name]) for name in ("front", "error", "parallax", "foot"))
    return ", ".join(f"{name} {value:.2f}" if isfinite(value) else f"{name} unknown" for name, value in found)


def _why(row: dict[str, Any], rule: str) -> str:
    """What else made the answer, where the affinity with the world did not."""
    if rule == "keep":
        return "kept as it was proposed: "
    if rule == "spectral":
        return f"the clusters of the affinity have it {'apart from' if row['group'] else 'with'} the background: "
    moves = isfinite(row["world"]) and row["world"] < HALF
    if row["group"] and not moves:
        return "by the number of groups asked for, or joined by nearness to an instance that moves: "
    if not row["group"] and moves:
        return "it agreed with the world before that was refitted, or is too small or too short a mover: "
    return ""
