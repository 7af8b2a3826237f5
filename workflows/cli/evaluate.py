"""``zsmoseg evaluate``: masks against the truth of a dataset, as the official evaluators score them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from zsmoseg.metrics.protocols import DEFAULTS, PROTOCOLS, Rules
from zsmoseg.remote.url import local_folder
from zsmoseg.workflows.cli.run import positive
from zsmoseg.workflows.evaluate.reports import REPORTS, render

if TYPE_CHECKING:
    from zsmoseg.workflows.evaluate.scoreboard import Scoreboard


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``evaluate``."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "protocols:\n" + "\n".join(f"  {name:24} {p.about}" for name, p in PROTOCOLS.items())
    add = parser.add_argument
    add(
        "predictions",
        nargs="+",
        metavar="[NAME=]PREDICTION",
        help="a store (also by URL), an output folder of zsmoseg run, or a folder with SEQUENCE/*.png, SEQUENCE.npz or .npy",
    )
    add("--truth", type=Path, required=True, metavar="DATASET", help="root of a dataset, or its annotations")
    add(
        "--protocol",
        choices=tuple(PROTOCOLS),
        metavar="PROTOCOL",
        help="see below; default: " + ", ".join(f"{name} for {truth}" for truth, name in DEFAULTS.items()),
    )
    add("--format", choices=tuple(REPORTS), default="text")
    add("--sequences", metavar="A,B", help="sequences, published lists (davis-moving-val, ...) or all")
    add("--official", action="store_true", help="the official number also where it is known to be wrong")
    add(
        "--void",
        metavar="LABEL|none",
        help="the label in the truth that is void (default: the protocol's rule)",
    )
    add(
        "--motion-times",
        type=Path,
        metavar="FILE",
        help="CSV sequence,object,start,stop: frame numbers, stop exclusive, between which an object moves; adds J "
        "while moving and false objects a frame to moving",
    )
    add("--label", choices=("group", "instance"), default="group", help="which masks of zsmoseg are scored")
    add("--workers", type=positive, help="processes (default: the cores)")
    add("-o", "--out", type=local_folder, metavar="FILE", help="write there instead of to the terminal")


def main(options: argparse.Namespace) -> int:
    """Score and print."""
    from zsmoseg.errors import OutputError

    out: Path | None = options.out
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        raise OutputError(f"{out}: cannot be written: it is a folder, or in one that is not there")
    text = render(scoreboard(options), options.format)
    if out is None:
        print(text, end="")
        return 0
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({error.strerror})") from error
    return 0


def scoreboard(options: argparse.Namespace) -> Scoreboard:
    """Score what the options say."""
    from zsmoseg.datasets import open_dataset, select
    from zsmoseg.workflows.evaluate.evaluation import evaluate, read_times
    from zsmoseg.workflows.evaluate.predictions import named_predictions

    predictions = named_predictions(options.predictions, options.label)
    dataset = open_dataset(options.truth, options.protocol or DEFAULTS["masks"])
    protocol = options.protocol or DEFAULTS[dataset.truth_kind]
    wanted = [word.strip() for word in options.sequences.split(",")] if options.sequences else None
    selection = select(dataset, wanted, protocol)
    rules = _rules(options, protocol)
    times = (
        None if options.motion_times is None else read_times(options.motion_times, dataset, selection, rules)
    )
    return evaluate(predictions, dataset, selection, rules, times, options.workers)


def _rules(options: argparse.Namespace, protocol: str) -> Rules:
    from zsmoseg.errors import SettingsError

    void = PROTOCOLS[protocol].void
    if options.void is None:
        return Rules(protocol, void, options.official)
    if options.official:
        raise SettingsError(
            "--official and --void contradict each other: the official void rule is the default"
        )
    if options.void != "none" and not options.void.isdecimal():
        raise SettingsError(f"--void {options.void}: expected a label (255) or none")
    return Rules(protocol, None if options.void == "none" else int(options.void))
