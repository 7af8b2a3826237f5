"""``zsmoseg export VIDEO...``: the result for other tools."""

from __future__ import annotations

import argparse
from pathlib import Path

from zsmoseg.workflows.cli.common import store_option, store_path

FORMATS = {
    "davis": "OUT/VIDEO/FRAME.png, palette images (DAVIS)",
    "npz": "OUT/VIDEO.npz, one array `segmentation` (frame, y, x)",
    "coco": "OUT/VIDEO.json, COCO with run lengths and track_id",
    "ytvis": "OUT/VIDEO.json, YouTube-VIS with run lengths",
    "mots": "OUT/VIDEO.txt, MOTS text",
    "colmap": "OUT/VIDEO/IMAGE.png.png, 0 = moves, 255 = use (ImageReader.mask_path)",
    "nerfstudio": "OUT/VIDEO/masks/FRAME.png, 0 = moves, 255 = use",
    "flo": "OUT/flow/VIDEO/forward and backward, Middlebury .flo",
    "npy": "OUT/flow/VIDEO, OUT/depth/VIDEO: arrays of the cues",
    "png": "OUT/flow/VIDEO, OUT/depth/VIDEO: KITTI flow, 16-bit inverse depth",
    "netcdf": "OUT/VIDEO.nc: labels, masks, motion state and cues with coordinates",
    "zarr": "OUT/VIDEO.zarr: the same",
}


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``export``."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "formats:\n" + "\n".join(f"  {name:11} {what}" for name, what in FORMATS.items())
    parser.add_argument(
        "videos", metavar="VIDEO", nargs="+", help="name of a video in the store (see zsmoseg status)"
    )
    store_option(parser)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help="where to write")
    parser.add_argument("--format", choices=FORMATS, required=True, metavar="FORMAT", help="see below")
    parser.add_argument(
        "--what",
        choices=("group", "instance", "object"),
        help="what an id is: a group that moves (default), an instance that moves, an object, static ones too",
    )
    parser.add_argument(
        "--when",
        choices=("ever", "now"),
        help="paint a mover wherever it is seen (default), or only while it moves",
    )
    parser.add_argument(
        "--dilate",
        type=int,
        metavar="PX",
        help="by how many pixels the ignored regions grow (colmap, nerfstudio)",
    )
    parser.add_argument(
        "--cue",
        choices=("flow", "depth"),
        action="append",
        help="which cues, on the working grid (npy, png, netcdf, zarr; default: flow); may be repeated",
    )
    parser.add_argument("--run", help="of this run instead of the latest (see zsmoseg runs)")


def main(options: argparse.Namespace) -> int:
    """Write the files."""
    from zsmoseg.workflows.export.exporting import choose, export
    from zsmoseg.workflows.result import open_store

    chosen = choose(options.format, options.what, options.when, options.dilate, options.cue)
    store = open_store(store_path(options.store))
    results = [store.get(video, options.run) for video in dict.fromkeys(options.videos)]
    for path in export(results, options.out, chosen):
        print(path)
    return 0
