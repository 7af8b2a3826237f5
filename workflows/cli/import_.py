"""``zsmoseg import``: masks, flow or depth that exist already become cues of a store."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from zsmoseg.workflows.cli.common import OUT, store_option, store_path
from zsmoseg.workflows.cli.run import (
    cue_options,
    execution,
    execution_options,
    frame_options,
    overrides,
    setting_options,
)


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``import``."""
    parser.add_argument("sources", nargs="+", metavar="SOURCE", help="the videos, as for zsmoseg run")
    store_option(parser)
    cue_options(parser)
    setting_options(parser)
    frame_options(parser)
    execution_options(parser)


def main(options: argparse.Namespace) -> int:
    """Check all files, write the cues into the store, note them for the runs to come; 2 if a video failed.

    Raises
    ------
    SettingsError
        Nothing to import was named.
    """
    from zsmoseg.errors import SettingsError
    from zsmoseg.settings import resolve
    from zsmoseg.stores.location import Store
    from zsmoseg.workflows.imports.settling import KINDS
    from zsmoseg.workflows.imports.told import brought_lines
    from zsmoseg.workflows.planning.plan import VideoPlan
    from zsmoseg.workflows.running.progress import make_watcher
    from zsmoseg.workflows.running.request import Request
    from zsmoseg.workflows.running.run import each_plan, found_in, run
    from zsmoseg.workflows.wording import counted

    settings = resolve(options.preset, options.config, overrides(options))
    kinds = [kind for kind in KINDS if getattr(settings, kind).path]
    if not kinds:
        raise SettingsError("nothing to import; give --proposals, --flow or --depth with a path")
    store = store_path(options.store)
    request = Request(
        options.sources, Path(OUT), store, settings, until=kinds, imports=True, **execution(options)
    )
    with make_watcher() as watcher:
        report = run(request, watcher)
    opened = Store.open(store, create=True)
    for name, plan in each_plan(request, opened, found_in(request)):
        if name in report.finished and isinstance(plan, VideoPlan):
            for line in brought_lines(plan):
                print(f"{plan.name}: {line}")
    if report.failures:
        verb = "was" if len(report.failures) == 1 else "were"
        print(f"zsmoseg: {counted(len(report.failures), 'video')} {verb} not imported", file=sys.stderr)
        return 1
    without = " ".join(f"--set {kind}.source={KINDS[kind]}" for kind in kinds)
    print(f"zsmoseg run with --store {store} uses them from now on; without them: {without}")
    return 0
