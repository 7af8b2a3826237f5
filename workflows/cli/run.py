"""``zsmoseg run SOURCE...``: plan what is missing, compute it, write masks."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zsmoseg.remote.url import folder
from zsmoseg.workflows.cli.common import OUT, store_option, store_path

if TYPE_CHECKING:
    from zsmoseg.workflows.running.request import Request


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``run``."""
    add = parser.add_argument
    add(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="video file, folder of frames, glob, or dataset folder; a path or a URL",
    )
    add(
        "-o",
        "--out",
        type=folder,
        default=Path(OUT),
        help=f"output folder, or s3://bucket/name (default: {OUT})",
    )
    store_option(parser)
    add("--groups", metavar="auto|K", help="number of groups, the static one included (groups.count)")
    setting_options(parser)
    add("--from", dest="start_from", metavar="STAGE", help="compute STAGE and all that hangs on it again")
    add("--until", metavar="STAGE", help="stop after STAGE")
    add("--dry-run", action="store_true", help="print what would be done, and why")
    choice_options(parser)
    execution_options(parser)
    frame_options(parser)
    add("--ignore", metavar="MASK.png", help="pixels that count for nothing (ignore.mask)")
    cue_options(parser)


def choice_options(parser: argparse.ArgumentParser) -> None:
    """Which of the videos that were found."""
    add = parser.add_argument
    add(
        "--only",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="these videos of the sources, by the names they have in OUT; patterns in quotes",
    )
    add(
        "--slice",
        type=share,
        metavar="i/n",
        help="the i-th of n shares, 1/n to n/n: for job arrays; every video is in exactly one",
    )
    add(
        "--retry-failed",
        action="store_true",
        help="those that failed or were interrupted when they ran last with this store",
    )
    add("--limit", type=positive, metavar="N", help="the first N of what is left by the options above")
    add("--events", type=Path, metavar="FILE", help="append what happens as JSON lines")


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
    add(
        "--scheduler",
        default=os.environ.get("DASK_SCHEDULER_ADDRESS") or "local",
        help="local, serial, the address of a Dask scheduler, or its file (default: $DASK_SCHEDULER_ADDRESS, or local)",
    )
    add("--workers", type=positive, help="worker processes of --scheduler local (default: the cores)")
    add(
        "--steal",
        action="store_true",
        help="take over what another run left locked, if it gave no sign for 30 s, without watching it first",
    )
    add(
        "--keep",
        choices=("masks", "cues", "all"),
        default="all",
        help="what stays in the store once a video is finished: what results are read from (masks), frames, flow and depth "
        "too, or all (default); what is gone is made again where another setting needs it",
    )
    add(
        "--patience",
        type=seconds,
        default=300.0,
        metavar="SECONDS",
        help="give up when a cluster had no worker for so long (default: 300)",
    )


def execution(options: argparse.Namespace) -> dict[str, Any]:
    """What these options say, for a ``Request``."""
    return {name: getattr(options, name) for name in ("scheduler", "workers", "patience", "steal", "keep")}


def frame_options(parser: argparse.ArgumentParser) -> None:
    """Which frames are used."""
    add = parser.add_argument
    add("--start", metavar="T", help="first frame: seconds, 1:02:03.5, or 300f (video.start)")
    add("--end", metavar="T", help="end, exclusive: seconds, 1:02:03.5, or 300f (video.end)")
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
        choices=("depth", "inverse-depth", "disparity"),
        help="depth: larger = farther; inverse-depth: larger = nearer; disparity: the same, 0 and less unknown (depth.kind)",
    )


def share(text: str) -> tuple[int, int]:
    """``i/n``, i from 1 to n."""
    i, slash, n = text.partition("/")
    if not (slash and i.isdecimal() and n.isdecimal() and 1 <= int(i) <= int(n)):
        raise argparse.ArgumentTypeError(f"{text}: expected i/n with i from 1 to n, as 3/20")
    return int(i), int(n)


def seconds(text: str) -> float:
    """A number of seconds."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: expected seconds, more than 0")
    return value


def positive(text: str) -> int:
    """An integer of at least 1."""
    value = int(text) if text.isdecimal() else 0
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
    """Run; 1 if a video failed."""
    from zsmoseg.settings import resolve
    from zsmoseg.workflows.running.request import Choice, Request
    from zsmoseg.workflows.running.run import dry_run

    request = Request(
        options.sources,
        options.out,
        store_path(options.store, options.out),
        resolve(options.preset, options.config, overrides(options)),
        start_from=options.start_from,
        until=[options.until] if options.until else [],
        choice=Choice(options.only, options.slice, options.retry_failed, options.limit),
        **execution(options),
    )
    if options.dry_run:
        for line in dry_run(request):
            print(line)
        return 0
    return _run(request, options)


def _run(request: Request, options: argparse.Namespace) -> int:
    """Run with somebody looking on; at the end the table of failures."""
    from zsmoseg.workflows.running.events import Events
    from zsmoseg.workflows.running.progress import failure_lines, make_watcher
    from zsmoseg.workflows.running.run import run

    with make_watcher() as watcher, ExitStack() as stack:
        if options.events:
            events = stack.enter_context(Events(options.events, watcher))
            report = run(request, events)
            events.ended(report)
        else:
            report = run(request, watcher)
    videos = len(report.failures) + len(report.finished)
    planned = report.failures.keys() <= report.planned
    for line in failure_lines(report.failures, videos, again(options.words, planned)):
        print(line, file=sys.stderr)
    if not report.failures:
        return 0
    return 1 if report.started else 2


def again(words: Sequence[str], laid_out: bool = True) -> str:
    """The command that does what failed, and nothing else.

    Parameters
    ----------
    laid_out
        The run has taken back what ``--from`` asks for: once more would lose what was finished since.
    """
    at = [*words, "--"].index("--")
    kept, sources = list(words[:at]), words[at:]
    while laid_out and "--from" in kept:
        at = kept.index("--from")
        del kept[at : at + 2]
    kept = [word for word in kept if not (laid_out and word.startswith("--from="))]
    retry = [] if "--retry-failed" in kept else ["--retry-failed"]
    return shlex.join(["zsmoseg", *kept, *retry, *sources])
