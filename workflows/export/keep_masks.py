"""Export of pixels to keep, for reconstruction: one image a frame, called as COLMAP and nerfstudio look for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from zsmoseg.errors import OutputError
from zsmoseg.formats.keep import encode_keep
from zsmoseg.stores import files
from zsmoseg.workflows.export.painting import image_names, painted
from zsmoseg.workflows.export.registry import Choice
from zsmoseg.workflows.result import Result


def write_colmap(result: Result, path: Path, choice: Choice) -> None:
    """Called like the image, ``.png`` added."""
    _write([f"{name}.png" for name in image_names(result)], result, path, choice)


def write_nerfstudio(result: Result, path: Path, choice: Choice) -> None:
    """Called like the frame, in a folder ``masks``."""
    _write([f"masks/{name}.png" for name in result.probe.names], result, path, choice)


def _write(names: Sequence[str], result: Result, path: Path, choice: Choice) -> None:
    for name, ids in zip(names, painted(result, "group", choice.when), strict=True):
        files.write(files.below(path, name, OutputError), encode_keep(ids > 0, choice.dilate))
