"""A scoreboard as text, CSV, Markdown or LaTeX; each says which protocol, frames and void rule it used."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import NamedTuple

from zsmoseg.workflows.evaluate.scoreboard import FEWEST, Scoreboard, as_json, describe, differences, in_unit


class Table(NamedTuple):
    """A title, the heads of the columns, and rows; the last ``means`` rows are means."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    means: int = 0


def tables(board: Scoreboard) -> list[Table]:
    """A table for each method, the means, the differences, and what is published."""
    several = len(board.methods) > 1
    found = [_method(board, name) for name in board.methods]
    if several:
        rows = [[name, *_numbers(board, board.mean(name))] for name in board.methods]
        found += [Table("means", ["method", *board.metrics], rows), _differences(board)]
    return [*found, *published_tables(board)]


def published_tables(board: Scoreboard) -> list[Table]:
    """What is published under the same protocol, apart from what was measured; none where nothing is."""
    rows = [
        [row.method, row.training, row.labels]
        + [
            _number(board, metric, in_unit(board, value))
            for metric, value in zip(board.rules.entry.published, row.values, strict=True)
        ]
        + [row.source]
        for row in board.published()
    ]
    heads = ["published", "training", "labels", *board.rules.entry.published, "source"]
    return [Table(f"published, not computed here: {board.published_on()}", heads, rows)] if rows else []


def as_text(board: Scoreboard) -> str:
    """For the terminal."""
    about = [f"{key}: {value}" for key, value in _about(board)]
    return "\n".join([*about, *("\n" + aligned(table) for table in tables(board))])


def as_csv(board: Scoreboard) -> str:
    """One line a method and sequence, all digits; the mean of a method has the sequence ``mean``."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    about = describe(board)
    told = ["protocol", "frames", "void"]
    writer.writerow(["method", "sequence", *board.metrics, *told])
    words = [
        board.rules.protocol + (" (official)" if board.rules.official else ""),
        about["frames"],
        about["void"],
    ]
    for name, scores in board.methods.items():
        for sequence, score in scores.items():
            writer.writerow([name, sequence, *(score.values[m] for m in board.metrics), *words])
        writer.writerow([name, "mean", *board.mean(name).values(), *words])
    return out.getvalue()


def as_markdown(board: Scoreboard) -> str:
    """Tables for a README."""
    lines = [f"- {key}: {value}" for key, value in _about(board)]
    for table in tables(board):
        lines += ["", f"**{table.title}**", "", _line(table.heads), _line(["---"] * len(table.heads))]
        lines += [_line(row) for row in table.rows]
    return "\n".join(lines)


def as_latex(board: Scoreboard) -> str:
    """Tables for a paper (package booktabs)."""
    about = "; ".join(f"{key}: {value}" for key, value in _about(board))
    return "\n\n".join(_tabular(table, about) for table in tables(board))


def as_json_text(board: Scoreboard) -> str:
    """For programs."""
    return json.dumps(as_json(board), indent=1, allow_nan=False)


def _about(board: Scoreboard) -> list[tuple[str, str]]:
    return [("protocol", board.rules.protocol), *describe(board).items()]


def _method(board: Scoreboard, name: str) -> Table:
    rows = [[s, *_numbers(board, score.values)] for s, score in board.methods[name].items()]
    means = [[f"mean over {board.rules.entry.mean}", *_numbers(board, board.mean(name))]]
    if board.rules.entry.one_object and 0 < board.single() < len(rows):
        single = board.mean(name, one_object=True)
        means.append([f"mean of the {board.single()} with one object", *_numbers(board, single)])
    return Table(name, ["sequence", *board.metrics], rows + means, len(means))


def _differences(board: Scoreboard) -> Table:
    rows = [
        [
            f"{d.method} - {d.base}",
            d.metric,
            _number(board, d.metric, d.difference, "+"),
            f"{_number(board, d.metric, d.low, '+')} to {_number(board, d.metric, d.high, '+')}",
            "yes" if d.clear else "no, may be chance" if d.sequences >= FEWEST else "too few sequences",
        ]
        for d in differences(board)
    ]
    title = "differences, with the 95 % bootstrap interval over sequences"
    return Table(title, ["methods", "metric", "difference", "interval", "clear"], rows)


def _numbers(board: Scoreboard, values: dict[str, float]) -> list[str]:
    return [_number(board, name, values[name]) for name in board.metrics]


def _number(board: Scoreboard, metric: str, value: float, sign: str = "") -> str:
    digits = 2 if board.rules.entry.unit == "percent" else 3
    return "-" if math.isnan(value) else f"{value:{sign}.{digits}f}"


def aligned(table: Table) -> str:
    """Its title and its rows, in columns."""
    grid = [list(table.heads), *map(list, table.rows)]
    widths = [max(len(row[n]) for row in grid) for n in range(len(table.heads))]
    rows = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in grid
    ]
    return "\n".join([table.title, *(row.rstrip() for row in rows)])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _tabular(table: Table, about: str) -> str:
    rows = [" & ".join(_escaped(cell) for cell in row) + r" \\" for row in table.rows]
    if table.means:
        rows.insert(len(rows) - table.means, r"\midrule")
    return "\n".join(
        [
            "% " + about,
            "% " + table.title,
            r"\begin{tabular}{l" + "r" * (len(table.heads) - 1) + "}",
            r"\toprule",
            " & ".join(_escaped(head) for head in table.heads) + r" \\",
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
        ]
    )


def _escaped(text: str) -> str:
    """Text with the signs that LaTeX reads as commands taken back."""
    return "".join("\\" + sign if sign in "&%$#_{}" else sign for sign in text.replace("\\", "/"))
