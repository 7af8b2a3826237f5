"""``zsmoseg export VIDEO...``: the result for other tools."""

from __future__ import annotations

import argparse

from zsmoseg.remote.url import local_folder
from zsmoseg.workflows.cli.common import store_option, store_path
from zsmoseg.workflows.export.registry import FORMATS, taking


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``export``."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "formats:\n" + "\n".join(f"  {f.name:11} {f.help}" for f in FORMATS.values())
    parser.add_argument(
        "videos", metavar="VIDEO", nargs="+", help="name of a video in the store (see zsmoseg status)"
    )
    store_option(parser)
    parser.add_argument("-o", "--out", type=local_folder, required=True, metavar="OUT", help="where to write")
    parser.add_argument("--format", choices=FORMATS, required=True, metavar="FORMAT", help="see below")
    parser.add_argument(
        "--what",
        choices=("group", "instance", "object"),
        help="what an id is: a group that moves (default), an object that moves, any object; objects by the numbers of objects/",
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
        help=f"by how many pixels the ignored regions grow ({taking('dilate')})",
    )
    parser.add_argument(
        "--images",
        metavar="FOLDER",
        help="images that the masks are for, where they are not those of the source: all frames of a video file, "
        f"extracted in order ({taking('images')}; default: those of the source, 00000.png ... of a video file)",
    )
    parser.add_argument(
        "--cue",
        choices=("flow", "depth"),
        action="append",
        help=f"which cues, on the working grid ({taking('cue')}; default: flow); may be repeated",
    )
    parser.add_argument("--run", help="of this run instead of the latest (see zsmoseg runs)")


def main(options: argparse.Namespace) -> int:
    """Write the files."""
    from zsmoseg.workflows.export.exporting import choose, export
    from zsmoseg.workflows.result import open_store

    chosen = choose(options.format, options.what, options.when, options.dilate, options.cue, options.images)
    store = open_store(store_path(options.store))
    results = [store.get(video, options.run) for video in dict.fromkeys(options.videos)]
    for path in export(results, options.out, chosen):
        print(path)
    return 0
