"""``zsmoseg run SOURCE...``: plan what is missing, compute it, write masks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from zsmoseg.workflows.cli.common import OUT, store_option, store_path


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``run``."""
    add = parser.add_argument
    add("sources", nargs="+", metavar="SOURCE", help="video file, folder of frames, glob, or dataset folder")
    add("-o", "--out", type=Path, default=Path(OUT), help=f"output folder (default: {OUT})")
    store_option(parser)
    add("--groups", metavar="auto|K", help="number of groups, the static one included (groups.count)")
    setting_options(parser)
    add("--from", dest="start_from", metavar="STAGE", help="compute STAGE and all that hangs on it again")
    add("--until", metavar="STAGE", help="stop after STAGE")
    add("--dry-run", action="store_true", help="print what would be done, and why")
    execution_options(parser)
    frame_options(parser)
    add("--ignore", metavar="MASK.png", help="pixels that count for nothing (ignore.mask)")
    cue_options(parser)


def setting_options(parser: argparse.ArgumentParser) -> None:
    """Settings: a preset, a file, single ones."""
    add = parser.add_argument
    add(
        "--preset",
        default="embedded",
        help="embedded; paper: its networks and its rule to the letter; paper-core: the rule alone; permissive: networks "
        "whose weights may be used commercially, our rule",
    )
    add("--prompt", metavar="WORDS", help='what to look for instead of tags: "person, dog" (tags.prompt)')
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="one setting; see zsmoseg settings")
    add("--config", type=Path, metavar="FILE", help="settings in TOML")


def execution_options(parser: argparse.ArgumentParser) -> None:
    """Where it runs."""
    add = parser.add_argument
    add("--scheduler", default="local", help="local, serial, the address of a Dask scheduler, or its file")
    add("--workers", type=positive, help="worker processes of --scheduler local (default: the cores)")


def frame_options(parser: argparse.ArgumentParser) -> None:
    """Which frames are used."""
    add = parser.add_argument
    add("--start", metavar="T", help="first frame: seconds, or 300f (video.start)")
    add("--end", metavar="T", help="end, exclusive: seconds, or 300f (video.end)")
    add("--every", metavar="N", help="use every n-th frame (video.every)")
    add("--allow-truncated", action="store_true", help="use what can be decoded of a damaged video")


def cue_options(parser: argparse.ArgumentParser) -> None:
    """What users bring instead of computing it."""
    add = parser.add_argument
    add(
        "--proposals",
        metavar="PATH",
        help="masks: of this video, or a folder with one a video (proposals.path)",
    )
    add("--flow", metavar="PATH", help="optical flow, likewise (flow.path)")
    add("--depth", metavar="PATH", help="depth, likewise (depth.path), with --depth-is")
    add(
        "--depth-is",
        choices=("depth", "inverse-depth"),
        help="depth: larger = farther; inverse-depth: larger = nearer (depth.kind)",
    )


def positive(text: str) -> int:
    """An integer of at least 1."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: expected 1 or more")
    return value


def overrides(options: argparse.Namespace) -> dict[str, Any]:
    """The settings given on the command line, by dotted name."""
    from zsmoseg.settings import parse_override

    given = dict(parse_override(text) for text in options.set)
    named = {
        "groups.count": "groups",
        "tags.prompt": "prompt",
        "video.start": "start",
        "video.end": "end",
        "video.every": "every",
        "video.allow_truncated": "allow_truncated",
        "ignore.mask": "ignore",
        "proposals.path": "proposals",
        "flow.path": "flow",
        "depth.path": "depth",
        "depth.kind": "depth_is",
    }
    told = {name: getattr(options, option, None) for name, option in named.items()}
    return given | {name: value for name, value in told.items() if value not in (None, False)}


def main(options: argparse.Namespace) -> int:
    """Run; 2 if a video failed."""
    from zsmoseg.settings import resolve
    from zsmoseg.workflows.running.request import Request
    from zsmoseg.workflows.running.run import dry_run, run

    request = Request(
        options.sources,
        options.out,
        store_path(options.store, options.out),
        resolve(options.preset, options.config, overrides(options)),
        options.scheduler,
        options.workers,
        options.start_from,
        [options.until] if options.until else [],
    )
    if options.dry_run:
        for line in dry_run(request):
            print(line)
        return 0
    from zsmoseg.workflows.running.progress import make_watcher

    with make_watcher() as watcher:
        report = run(request, watcher)
    if report.failures:
        print(
            f"zsmoseg: {len(report.failures)} of {len(report.failures) + len(report.summaries)} videos failed",
            file=sys.stderr,
        )
        return 2
    return 0
