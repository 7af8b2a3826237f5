"""``zsmoseg ablate``: the steps of the paper, and any setting, one after the other over the same cues."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from zsmoseg.remote.url import local_folder
from zsmoseg.workflows.cli.common import OUT, store_option, store_path
from zsmoseg.workflows.cli.run import (
    cue_options,
    execution,
    execution_options,
    frame_options,
    overrides,
    setting_options,
)
from zsmoseg.workflows.evaluate.reports import REPORTS, render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from zsmoseg.workflows.ablation import Variant
    from zsmoseg.workflows.evaluate.scoreboard import Scoreboard

DEFAULT = Path("zsmoseg-ablation")
SHOWN = ("Fu", "Fu_binary", "J")


def options(parser: argparse.ArgumentParser) -> None:
    """The options of ``ablate``."""
    add = parser.add_argument
    add("sources", nargs="+", metavar="SOURCE", help="the videos, as for zsmoseg run")
    add("--truth", type=Path, required=True, metavar="DATASET", help="root of a dataset, or its annotations")
    add(
        "--sweep",
        action="append",
        default=[],
        metavar="KEY=A,B",
        help="instead of the paper's steps: a setting and its values; may be repeated, each is a table and a plot",
    )
    add("--format", choices=tuple(REPORTS), default="text", help="of the tables")
    add(
        "-o",
        "--out",
        type=local_folder,
        default=DEFAULT,
        help=f"folder of tables and plots (default: {DEFAULT})",
    )
    store_option(parser)
    add("--groups", metavar="auto|K", help="number of groups, the static one included (groups.count)")
    setting_options(parser)
    execution_options(parser)
    frame_options(parser)
    add("--ignore", metavar="MASK.png", help="pixels that count for nothing (ignore.mask)")
    cue_options(parser)


def main(options: argparse.Namespace) -> int:
    """Run, score, print the means; write every table, and a plot of every sweep.

    Raises
    ------
    ZsmosegError
        Bad settings, sources or truth; a video that failed; an output folder that is not ours.
    """
    from zsmoseg.datasets import open_dataset
    from zsmoseg.settings import resolve
    from zsmoseg.stores.output import Output
    from zsmoseg.workflows.ablation import PROTOCOL, ablate, cues, paper_steps
    from zsmoseg.workflows.evaluate.report_tables import aligned, published_tables
    from zsmoseg.workflows.running.progress import Steps
    from zsmoseg.workflows.running.request import Request

    sweeps = _sweeps(options.sweep)
    output = Output(options.out, "ablation")
    output.refuse_foreign()
    dataset = open_dataset(options.truth, PROTOCOL)
    request = Request(
        options.sources,
        Path(OUT),
        store_path(options.store),
        **execution(options),
    )
    given = options.preset, options.config, overrides(options)
    for variants in sweeps.values():
        for variant in variants:
            resolve(*given[:2], {**given[2], **variant.settings})
    sources = cues(replace(request, settings=resolve(*given)))
    print(", ".join(f"{kind}: {source}" for kind, source in sources.items()))
    sweeps = sweeps or {"steps": paper_steps(sources["depth"] != "constant")}
    output.claim({})
    for name, variants in sweeps.items():
        board = ablate(request, *given, variants, dataset, Steps())
        print(*_means(board, variants), *map(aligned, published_tables(board)), sep="\n")
        file = f"{name}{REPORTS[options.format].ending}"
        output.write(file, render(board, options.format).encode(), name)
        if options.sweep:
            output.write(f"{name}.png", _plot(name, board), name)
    print(f"tables of every sequence, and differences with their uncertainty: {output.path}")
    return 0


def _sweeps(texts: Sequence[str]) -> dict[str, list[Variant]]:
    """The variants of each setting that is swept; a value given twice counts once."""
    from zsmoseg.workflows.ablation import sweep

    sweeps: dict[str, list[Variant]] = {}
    for text in texts:
        known = sweeps.setdefault(text.partition("=")[0].strip(), [])
        known += [variant for variant in sweep(text) if variant not in known]
    return sweeps


def _means(board: Scoreboard, variants: Sequence[Variant]) -> list[str]:
    """A line a variant."""
    width = max(len(v.name) for v in variants)
    lines = [f"{'':<{width}}  " + "  ".join(f"{m:>9}" for m in board.metrics)]
    for variant in variants:
        mean = board.mean(variant.name)
        lines.append(f"{variant.name:<{width}}  " + "  ".join(f"{mean[m]:9.1f}" for m in board.metrics))
    return lines


def _plot(name: str, board: Scoreboard) -> bytes:
    """A PNG: mean scores over the values of one setting."""
    from io import BytesIO

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    labels = [method.partition(" = ")[2] for method in board.methods]
    for metric in SHOWN:
        axes.plot(labels, [board.mean(method)[metric] for method in board.methods], marker="o", label=metric)
    axes.set_xlabel(name)
    axes.set_ylabel("percent, mean over sequences")
    axes.set_title(f"{board.truth.split(',')[0]}: {board.sequences}", fontsize="small")
    axes.grid(alpha=0.3)
    axes.legend()
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Software": None})
    return buffer.getvalue()
