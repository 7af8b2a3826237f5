"""``zsmoseg explain VIDEO``: why each object was called moving or static, in words."""

from __future__ import annotations

import argparse
from typing import Any

from zsmoseg.workflows.cli.common import store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``explain``."""
    parser.add_argument("video", help="name of a video in the store (see zsmoseg status)")
    store_option(parser)
    parser.add_argument("--object", type=int, metavar="N", help="only this object (value in the labels)")
    parser.add_argument("--run", help="of this run instead of the latest (see zsmoseg runs)")


def main(options: argparse.Namespace) -> int:
    """Print the evidence.

    Raises
    ------
    StoreError
        There is no such object.
    """
    from zsmoseg.errors import StoreError
    from zsmoseg.workflows.evidence import details
    from zsmoseg.workflows.result import open_store

    result = open_store(store_path(options.store)).get(options.video, options.run)
    table, moving = result.objects, result.moving()
    described = result.artifact("groups").description or {}
    chosen = described["settings"]["groups"]
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
        print(sentence(row, int(moving[:, row["object"]].sum()), chosen["rule"], float(chosen["visible"])))
    if options.object:
        for line in details(result, options.object):
            print(f"  {line}")
    return 0


def sentence(row: dict[str, Any], frames_moving: int, rule: str, visible: float) -> str:
    """The evidence for one object in words; ``rule`` and ``visible`` are the settings of ``groups``."""
    seen = f"object {row['object']}: seen in {row['frames']} frames, {row['area']} pixels in all"
    answer = (
        f"group {row['group']}, instance {row['instance']}, moving in {frames_moving} frames"
        if row["group"]
        else "static"
    )
    evidence = (
        f"one motion for it and the static world costs {row['score']:.3f} px more than a motion of its own"
    )
    if rule == "keep":
        return f"{seen}; {evidence}; kept as it was proposed: {answer}"
    if rule == "spectral":
        word = "apart from" if row["group"] else "with"
        return f"{seen}; {evidence}; the clusters of the affinity have it {word} the background: {answer}"
    if row["group"] == 0 and row["visibility"] < visible:
        return (
            f"{seen}; the static world's motion explains its image as well as its own flow does (error ratio "
            f"{row['visibility']:.2f}, needed {visible:.2f}): static"
        )
    joined = (
        ""
        if not row["group"] or row["score"] > row["threshold"]
        else ", joined by nearness to an instance that moves"
    )
    return f"{seen}; {evidence}; the threshold is {row['threshold']:.3f} px: {answer}{joined}"
