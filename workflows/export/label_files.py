"""Export of ids: one file or folder a video, as DAVIS, the tracks' evaluator, COCO, YouTube-VIS and MOTS have them."""

from __future__ import annotations

from pathlib import Path

from zsmoseg.errors import FormatError, OutputError
from zsmoseg.formats.coco import encode_coco
from zsmoseg.formats.mots import PER_CLASS, encode_mots, too_high
from zsmoseg.formats.npy import write_volume
from zsmoseg.formats.ytvis import encode_ytvis
from zsmoseg.painting.palette import encode_png
from zsmoseg.stores import files
from zsmoseg.workflows.export.painting import image_names, names_of_ids, number_tables, painted
from zsmoseg.workflows.export.registry import Choice
from zsmoseg.workflows.result import Result


def write_davis(result: Result, path: Path, choice: Choice) -> None:
    """A palette image a frame."""
    for name, ids in zip(result.probe.names, painted(result, choice.what, choice.when), strict=True):
        files.write(files.below(path, f"{name}.png", OutputError, one=True), encode_png(ids))


def write_npz(result: Result, path: Path, choice: Choice) -> None:
    """One array (frame, y, x) of uint16."""
    probe = result.probe
    shape = (len(probe.times), probe.height, probe.width)
    write_volume(path, "segmentation", painted(result, choice.what, choice.when), shape, "uint16")


def write_coco(result: Result, path: Path, choice: Choice) -> None:
    """COCO JSON; an id is a ``track_id``."""
    size = result.probe.height, result.probe.width
    ids = painted(result, choice.what, choice.when)
    files.write(path, encode_coco(image_names(result, True), ids, size, names_of_ids(result, choice.what)))


def write_ytvis(result: Result, path: Path, choice: Choice) -> None:
    """YouTube-VIS JSON; an id is that of a track."""
    size, names = (result.probe.height, result.probe.width), image_names(result, True)
    ids, called = painted(result, choice.what, choice.when), names_of_ids(result, choice.what)
    files.write(path, encode_ytvis(result.name, names, ids, size, called))


def write_mots(result: Result, path: Path, choice: Choice) -> None:
    """MOTS text."""
    ids = painted(result, choice.what, choice.when)
    files.write(path, encode_mots(ids, names_of_ids(result, choice.what)))


def check_mots(result: Result, choice: Choice) -> None:
    """Raise ``FormatError`` where an object has a number that MOTS text cannot hold."""
    highest = int(number_tables(result, choice.what, choice.when).max(initial=0))
    if highest >= PER_CLASS:
        raise FormatError(f"{result.name}: {too_high(highest)}")
