"""When each object moves: a CSV file with the columns ``sequence,object,start,stop``."""

from __future__ import annotations

import csv
from pathlib import Path

from zsmoseg.errors import FormatError

COLUMNS = ["sequence", "object", "start", "stop"]


def read_motion_times(path: Path) -> dict[str, dict[int, list[tuple[int, int]]]]:
    """Of each sequence and object, the frame numbers ``start`` to ``stop`` (exclusive) between which it moves.

    Raises
    ------
    FormatError
        Not readable, other columns, or a row that is no such span; the message names the line.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: cannot be read as CSV ({error})") from error
    if not lines or lines[0] != COLUMNS:
        raise FormatError(f"{path}: the first line must be {','.join(COLUMNS)}")
    times: dict[str, dict[int, list[tuple[int, int]]]] = {}
    for number, line in enumerate(lines[1:], 2):
        if len(line) != len(COLUMNS) or not all(cell.strip().isdecimal() for cell in line[1:]):
            raise FormatError(f"{path}, line {number}: expected a sequence and three whole numbers")
        label, start, stop = (int(cell) for cell in line[1:])
        if start >= stop:
            raise FormatError(f"{path}, line {number}: start {start} is not before stop {stop} (exclusive)")
        times.setdefault(line[0].strip(), {}).setdefault(label, []).append((start, stop))
    return times
