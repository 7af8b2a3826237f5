"""The evidence for the objects of a video in sentences: what was measured, and what followed from it or overrode it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Any

from zsmoseg.grouping.decisions import BORDER, Reason
from zsmoseg.workflows.wording import counted

UNSEEN = "no pair of frames shows it against the static world"
Row = Mapping[str, Any]
"""Of the table ``Result.objects`` or ``Result.pieces``."""

MOVES = {
    Reason.EVIDENCE: "so it moves",
    Reason.JOINED: "it moves all the same, for it is near to what moves in its group and counts as one with it",
    Reason.COUNT: "it moves all the same, by the number of groups asked for",
    Reason.CUES: "it moves by the affinity of the kernel and the cues chosen",
    Reason.CLUSTERS: "it moves, for the clusters of the affinity have it apart from the background",
    Reason.TORN: "it moves all the same, for it is held together with a larger object that moves, as a limb with its body",
    Reason.KEPT: "it moves, for all are kept as they were proposed",
}
RESTS = {
    Reason.EVIDENCE: "so it is static",
    Reason.UNKNOWN: "so it counts as static",
    Reason.COUNT: "it is static all the same, by the number of groups asked for",
    Reason.SMALL: "it is static all the same, for it is too small beside the largest mover and belongs to none",
    Reason.SHORT: "it is static all the same, for too few pairs of frames show it and it belongs to none",
    Reason.REFITTED: "it is static all the same, for it agreed with the world before that was refitted",
    Reason.CUES: "it is static by the affinity of the kernel and the cues chosen",
    Reason.CLUSTERS: "it is static, for the clusters of the affinity have it with the background",
}


def of_object(thing: Row, pieces: Sequence[Row], visible: float) -> Iterator[str]:
    """A line for an object; where it was proposed in pieces, one for each of them under it.

    Parameters
    ----------
    visible : the setting ``affinity.visible`` that it was grouped with.
    """
    called = f" ({thing['category']})" if thing.get("category") else ""
    name = f"object {thing['object']}{called}"
    if len(pieces) == 1:
        yield f"{name}: {_seen(thing)}; {evidence(pieces[0], visible)}"
        return
    numbers = ", ".join(str(piece["piece"]) for piece in pieces)
    yield f"{name}: {_seen(thing)}; group {thing['group']}, pieces {numbers}"
    for piece in pieces:
        yield f"  {of_piece(piece, visible)}"


def of_piece(piece: Row, visible: float) -> str:
    """A line for a piece."""
    return f"piece {piece['piece']} of object {piece['object']}: {_seen(piece)}; {evidence(piece, visible)}"


def _seen(row: Row) -> str:
    moving = ""
    if row["group"]:
        moving = f", moving in {row['frames_moving']} of them" if row["frames_moving"] else ", resting in all"
    return f"seen in {counted(row['frames'], 'frame')}{moving}, {counted(row['area'], 'pixel')} in all"


def evidence(piece: Row, visible: float) -> str:
    """What was measured of a piece, and what decided."""
    return f"{_measured(piece, visible)}; {_decided(piece)}"


def _measured(piece: Row, visible: float) -> str:
    if piece["geometry"] == "obeys":
        return f"it stands on the ground beside it: {_geometry(piece)}: affinity {piece['world']:.2f} with the world"
    return f"{_beside(piece)}{_against_world(piece, visible)}"


def _geometry(piece: Row) -> str:
    """What was measured of its geometry."""
    found = ((name, piece[name]) for name in ("front", "error", "parallax", "foot", "beside"))
    return ", ".join(f"{name} {value:.2f}" if isfinite(value) else f"{name} unknown" for name, value in found)


def _beside(piece: Row) -> str:
    """What the geometry of the static world says of what does not obey it."""
    if piece["geometry"] == "not asked":
        return ""
    if piece["geometry"] == "breaks":
        return f"it does not stand on the ground beside it: {_geometry(piece)}; "
    return f"whether it stands on the ground beside it is not known ({piece['geometry']}); "


def _against_world(piece: Row, visible: float) -> str:
    if isfinite(piece["world"]):
        side = "below" if piece["world"] < BORDER else "not below"
        return (
            f"one motion for it and the static world costs {piece['excess']:.3f} px more than one each, "
            f"{piece['tolerance']:.3f} px are tolerated: affinity {piece['world']:.2f} with the world, {side} the "
            f"border of {BORDER:.2f}"
        )
    if piece["visibility"] == 0:  # neither motion left anything: there was nothing to look at
        return UNSEEN
    if piece["visibility"] < visible:
        return (
            "the static world's motion explains its image as well as its own flow does (error ratio "
            f"{piece['visibility']:.2f}, needed {visible:.2f})"
        )
    if piece["counts"]:
        return UNSEEN
    return "what it costs the static world counts for nothing beside what stands on the ground"


def _decided(piece: Row) -> str:
    reason = Reason(piece["reason"])
    if piece["group"]:
        return f"{MOVES[reason]}: group {piece['group']}"
    return RESTS[reason]
