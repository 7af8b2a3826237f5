"""``zsmoseg settings``: every setting with default, unit, allowed values and meaning."""

from __future__ import annotations

import argparse


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``settings``."""
    parser.add_argument("name", nargs="?", default="", help="only those whose name contains this")


def main(options: argparse.Namespace) -> int:
    """Two lines a setting: name, default, unit, allowed values; meaning and the stages that read it.

    Raises
    ------
    SettingsError
        If no name contains ``name``.
    """
    from zsmoseg.errors import SettingsError
    from zsmoseg.settings import PRESETS, defaults, describe
    from zsmoseg.workflows.stages.graph import readers

    names = [name for name in defaults() if options.name in name]
    if not names:
        raise SettingsError(f"no setting has {options.name!r} in its name; zsmoseg settings lists them all")
    for name in names:
        about = describe(name)
        stages = ", ".join(readers(name.split(".")[0]))
        print(f"{name} = {about['default']!r:<10} {about['unit']}  ({about['allowed']})")
        print(f"    {about['meaning']}" + (f" [{stages}]" if stages else ""))
    if not options.name:
        for preset, values in PRESETS.items():
            print(f"--preset {preset}: " + ", ".join(f"{n} = {v}" for n, v in values.items()))
    return 0
