"""Parts of real videos that never show what moves: the share of pixels that is called moving should be 0.

    python benchmarks/background_crops.py DAVIS OUT [SETTING=VALUE]...

Of each sequence of DAVIS the largest window (area times root of its frames; 60 frames if there is one, else 45 or 30) that the
annotated object, grown by 20 px, never enters. Nothing moves in the first seven, by eye; the building of car-shadow is
static too; the water of the last two is not rigid.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np

from zsmoseg.settings import parse_override, resolve
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import run

STATIC = (
    "bmx-trees",
    "dog",
    "drift-straight",
    "goat",
    "horsejump-high",
    "libby",
    "paragliding-launch",
)
OTHERS = ("car-shadow", "kite-surf", "blackswan")
LENGTHS = (60, 45, 30)
GROWN = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (41, 41))
STEP, EVERY, ROWS, COLUMNS, LEAST = 4, 5, 5, 6, 50
"""px of a cell; frames from one start to the next; cells from one border to the next; cells of a side at least."""

Window = tuple[slice, slice, slice]
"""Frames, rows, columns."""


def best_window(masks: np.ndarray) -> Window:
    """The best window of masks (frames, h, w) of what moves; ends the script where there is none."""
    lengths = dict.fromkeys(min(len(masks), n) if n == LENGTHS[0] else n for n in LENGTHS)
    for length in lengths:
        found = [
            (area * length**0.5, start, rows, columns)
            for start in range(0, len(masks) - length + 1, EVERY)
            for area, rows, columns in empty_boxes(masks[start : start + length].any(0))
        ]
        if found:
            _, start, rows, columns = max(found, key=lambda entry: entry[0])
            return slice(start, start + length), rows, columns
    sys.exit("no window without the object")


def empty_boxes(full: np.ndarray) -> list[tuple[int, slice, slice]]:
    """The widest empty box for each choice of two rows and a column on the left: area in cells, rows and columns in px."""
    total = np.pad(full.astype(np.int64).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    height, width = full.shape
    out = []
    for top in range(0, height - LEAST + 1, ROWS):
        for bottom in range(top + LEAST, height + 1, ROWS):
            across = total[bottom] - total[top]
            for left in range(0, width - LEAST + 1, COLUMNS):
                rights = np.arange(left + LEAST, width + 1, COLUMNS)
                free = rights[across[rights] == across[left]]
                if len(free):
                    right = int(free[-1])
                    rows, columns = slice(STEP * top, STEP * bottom), slice(STEP * left, STEP * right)
                    out.append(((bottom - top) * (right - left), rows, columns))
    return out


def crop(davis: Path, name: str, out: Path) -> None:
    """Write the crop of one sequence."""
    truth = sorted((davis / "Annotations/480p" / name).iterdir())
    grown = [cv2.dilate((cv2.imread(str(p), 0) > 127).astype(np.uint8), GROWN) for p in truth]
    frames, rows, columns = best_window(np.stack([mask[::STEP, ::STEP] > 0 for mask in grown]))
    shutil.rmtree(out / name, ignore_errors=True)
    (out / name).mkdir(parents=True)
    for t, path in enumerate(sorted((davis / "JPEGImages/480p" / name).iterdir())[frames]):
        cv2.imwrite(str(out / name / f"{t:05d}.png"), cv2.imread(str(path))[rows, columns])


def main() -> None:
    """Print the table."""
    davis, out = Path(sys.argv[1]), Path(sys.argv[2])
    chosen = resolve(overrides=dict(map(parse_override, ["overlay.write=false", *sys.argv[3:]])))
    for name in (*STATIC, *OTHERS):
        crop(davis, name, out / "clips")
    sources = [str(out / "clips" / name) for name in (*STATIC, *OTHERS)]
    run(Request(sources, out / "out", out / "store", chosen, "serial"))
    moving = {}
    for name in (*STATIC, *OTHERS):
        summary = json.loads((out / "out" / name / "summary.json").read_text())
        moving[name] = summary["moving_pixels_percent"]
        verdicts = [e["geometry"] for e in summary["evidence"]]
        print(f"{name:<20} {moving[name]:6.2f} % moving, {verdicts.count('obeys')} objects obey")
    print(f"empty: {sum(moving[name] == 0 for name in STATIC)} of {len(STATIC)}")


if __name__ == "__main__":
    main()
