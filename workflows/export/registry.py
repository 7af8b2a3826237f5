"""The export formats by name: all that tells one from another stands in its entry. A new one is a writer and an entry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from zsmoseg.errors import OutputError
from zsmoseg.metrics.registries import Deferred
from zsmoseg.stores import files

if TYPE_CHECKING:  # the command line lists the formats without numpy
    from zsmoseg.workflows.result import Result

LABELS = ("what", "when")
KEPT = ("when", "dilate", "images")


@dataclass(frozen=True)
class Choice:
    """What to export.

    Attributes
    ----------
    format : its name in ``FORMATS``.
    what : what an id is: ``group``, ``instance`` or ``object``.
    when : a mover is painted wherever it is seen, or only while it moves.
    dilate : px by which what moves grows.
    cues : ``flow``, ``depth``; of a format with one file or folder a cue, the one to write.
    images : folder of the images that the masks are for; empty: those of the source.
    """

    format: str
    what: str = "group"
    when: Literal["ever", "now"] = "ever"
    dilate: int = 0
    cues: tuple[str, ...] = ("flow",)
    images: str = ""


@dataclass(frozen=True)
class Format:
    """One export format.

    Attributes
    ----------
    name : on the command line.
    help : where it writes what, one line.
    write : writes one file or folder: the result, the path, the choice.
    ending : of the file; nothing for a folder.
    options : of ``what``, ``when``, ``dilate``, ``cue``, ``images``, those that change what is written.
    cues : whether cues are in it; ``each``: one file or folder for each of them.
    check : raises where a result does not fit the format, before anything is written.
    """

    name: str
    help: str
    write: Callable[[Result, Path, Choice], None]
    ending: str = ""
    options: tuple[str, ...] = ()
    cues: Literal["none", "inside", "each"] = "none"
    check: Callable[[Result, Choice], None] | None = None

    def path(self, out: Path, video: str, cue: str) -> Path:
        """The file or folder of one video (and cue) in the folder ``out``.

        Raises
        ------
        OutputError
            If the video has a name that leaves the folder, or there is a link.
        """
        folder = files.below(out, cue, OutputError, one=True) if self.cues == "each" else out
        return files.below(folder, f"{video}{self.ending}", OutputError, one=True)


def _in(file: str, function: str) -> Deferred:
    """A function of a file of this folder."""
    return Deferred(f"zsmoseg.workflows.export.{file}:{function}")


FORMATS: dict[str, Format] = {
    format.name: format
    for format in (
        Format(
            "davis",
            "OUT/VIDEO/FRAME.png, palette images (DAVIS)",
            _in("label_files", "write_davis"),
            options=LABELS,
        ),
        Format(
            "npz",
            "OUT/VIDEO.npz, one array `segmentation` (frame, y, x)",
            _in("label_files", "write_npz"),
            ".npz",
            LABELS,
        ),
        Format(
            "coco",
            "OUT/VIDEO.json, COCO with run lengths and track_id",
            _in("label_files", "write_coco"),
            ".json",
            LABELS,
        ),
        Format(
            "ytvis",
            "OUT/VIDEO.json, YouTube-VIS with run lengths",
            _in("label_files", "write_ytvis"),
            ".json",
            LABELS,
        ),
        Format(
            "mots",
            "OUT/VIDEO.txt, MOTS text",
            _in("label_files", "write_mots"),
            ".txt",
            LABELS,
            check=_in("label_files", "check_mots"),
        ),
        Format(
            "colmap",
            "OUT/VIDEO/IMAGE.jpg.png, 0 = moves, 255 = use, turned as images are stored (ImageReader.mask_path)",
            _in("keep_masks", "write_colmap"),
            options=KEPT,
            check=_in("keep_masks", "check_images"),
        ),
        Format(
            "nerfstudio",
            "OUT/VIDEO/masks/IMAGE.png, 0 = moves, 255 = use, turned as images are stored",
            _in("keep_masks", "write_nerfstudio"),
            options=KEPT,
            check=_in("keep_masks", "check_images"),
        ),
        Format(
            "flo",
            "OUT/flow/VIDEO/forward and backward, Middlebury .flo",
            _in("cue_files", "write_flo_files"),
            cues="each",
        ),
        Format(
            "npy",
            "OUT/flow/VIDEO, OUT/depth/VIDEO: arrays of the cues",
            _in("cue_files", "write_arrays"),
            options=("cue",),
            cues="each",
        ),
        Format(
            "png",
            "OUT/flow/VIDEO, OUT/depth/VIDEO: KITTI flow, 16-bit inverse depth",
            _in("cue_files", "write_images"),
            options=("cue",),
            cues="each",
        ),
        Format(
            "netcdf",
            "OUT/VIDEO.nc: labels, masks, motion state and cues with coordinates",
            _in("copying", "write_netcdf"),
            ".nc",
            (*LABELS, "cue"),
            cues="inside",
        ),
        Format(
            "zarr",
            "OUT/VIDEO.zarr: the same",
            _in("copying", "write_zarr"),
            ".zarr",
            (*LABELS, "cue"),
            cues="inside",
        ),
    )
}


def taking(option: str) -> str:
    """The names of the formats that an option is for."""
    return ", ".join(name for name, format in FORMATS.items() if option in format.options)
