"""What the grouping is worth on given proposals, and what halving or doubling each of its constants costs.

    zsmoseg import DAVIS/JPEGImages/480p --proposals PROPOSALS --depth DEPTH --depth-is inverse-depth --store STORE
    python benchmarks/sensitivity.py DAVIS STORE [table|sensitivity] [NAME=VALUE ...]

J: mean over the frames but the first and the last; Pu, Ru, Fu of all moving groups as one. ``bound``: the best choice
of objects, by falling precision; ``kept``: all of them. Of the ten sequences of the findings, and of the others. Settings
such as ``motion.model=affine`` hold for all runs.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from composites import TEN
from PIL import Image

from zsmoseg.settings import Settings, defaults, parse_override, resolve
from zsmoseg.stores.location import Store
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import each_plan, run
from zsmoseg.workflows.stages.front_end import Labels
from zsmoseg.workflows.stages.motion.groups import Groups

TUNED = {
    "statistics": ["noise_lag"],
    "affinity": ["floor", "most", "pair", "noise_area", "rounds", "visible"],
}
"""Sections whose numbers the grouping reads; of ``groups`` all that act but for the states."""


def overlaps(labels: Labels, truth: Path) -> np.ndarray:
    """(frames, objects, 2) pixels of the background and of the annotated object."""
    files = sorted(truth.glob("*.png"))
    tables = []
    for t, file in enumerate(files):
        mask = (np.asarray(Image.open(file)) > 0).astype(np.int64)
        code = labels.of(t, t + 1).label[0].astype(np.int64) * 2 + mask
        tables.append(np.bincount(code.ravel()))
    rows = max(len(table) for table in tables)
    rows += rows % 2
    return np.stack([np.pad(table, (0, rows - len(table))).reshape(-1, 2) for table in tables])


def score(table: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """J, Pu, Ru, Fu of the objects ``moving``."""
    chosen = table[:, np.pad(moving, (0, table.shape[1]))[: table.shape[1]]]
    hit, found, truth = chosen[..., 1].sum(1), chosen.sum((1, 2)), table[..., 1].sum(1)
    union = found + truth - hit
    j = np.where(union > 0, hit / np.maximum(union, 1), 1.0)[1:-1].mean()
    p, r = hit.sum() / max(found.sum(), 1), hit.sum() / max(truth.sum(), 1)
    return 100 * np.array([j, p, r, 2 * p * r / max(p + r, 1e-10)])


def best_choice(table: np.ndarray) -> np.ndarray:
    """The objects of the best choice of whole objects, by falling precision."""
    total = table.sum(0)
    order = np.argsort(-total[1:, 1] / np.maximum(total[1:].sum(1), 1), kind="stable") + 1
    choices = (order[:k] for k in range(1, len(order) + 1))
    of = range(len(total))
    return max(choices, key=lambda chosen: score(table, np.isin(of, chosen))[3], default=order)


def bound(table: np.ndarray) -> np.ndarray:
    """The best choice of whole objects."""
    return score(table, np.isin(range(table.shape[1]), best_choice(table)))


class Bench:
    """All sequences of DAVIS with the proposals that a store was given."""

    def __init__(self, davis: Path, store: Path, fixed: dict[str, Any]) -> None:
        self.davis, self.store, self.fixed = davis, store, fixed
        self.names = sorted(p.name for p in (davis / "JPEGImages/480p").iterdir())
        self.ten = np.isin(self.names, TEN)
        self.tables: dict[str, np.ndarray] = {}

    def scores(self, settings: dict[str, Any]) -> tuple[np.ndarray, list[int]]:
        """(sequences, 4) scores and the number of groups of each."""
        sources = [str(self.davis / "JPEGImages/480p" / name) for name in self.names]
        chosen = resolve(overrides={"overlay.write": False, **self.fixed, **settings})
        request = Request(sources, Path("unused"), self.store, chosen, "serial", until=["groups"])
        run(request)
        rows, groups = [], []
        for _, plan in each_plan(request, Store.open(self.store, create=False)):
            assert isinstance(plan, VideoPlan), plan
            labels, found = (plan.stages[n].artifact for n in ("labels", "groups"))
            assert labels is not None
            assert found is not None
            if plan.name not in self.tables:
                truth = self.davis / "Annotations/480p" / plan.name
                self.tables[plan.name] = overlaps(Labels.read(labels), truth)
            group = Groups.read(found).group
            rows.append(score(self.tables[plan.name], group > 0))
            groups.append(len(np.unique(np.append(group, 0))))
        return np.array(rows), groups

    def means(self, rows: np.ndarray) -> np.ndarray:
        """(2, 4): of the ten, and of the others."""
        return np.stack([rows[self.ten].mean(0), rows[~self.ten].mean(0)])


def others(name: str) -> list[float]:
    """Half and twice the default of a constant, within its range."""
    section, field_name = name.split(".")
    value = defaults()[name]
    field = type(getattr(Settings(), section)).model_json_schema()["properties"][field_name]
    kind = int if field.get("type") == "integer" else float
    found = [kind(value / 2), min(value * 2, field.get("maximum", value * 2))]
    return [v for v in dict.fromkeys(found) if v != value and v >= field.get("minimum", 0)]


def constants() -> list[str]:
    """The numbers that the default rule reads."""
    groups = Settings().groups
    numbers = [n for n, v in groups if isinstance(v, int | float) and not isinstance(v, bool)]
    acting = [n for n in numbers if groups.acts(n) and not n.startswith("state_")]
    return [f"{section}.{n}" for section, names in {**TUNED, "groups": acting}.items() for n in names]


def main() -> None:
    """Print the table, or the sensitivity."""
    fixed = dict(map(parse_override, sys.argv[4:]))
    bench = Bench(Path(sys.argv[1]), Path(sys.argv[2]), fixed)
    rows, groups = bench.scores({})
    what = sys.argv[3] if len(sys.argv) > 3 else "table"
    if what == "table":
        for name, row, count in zip(bench.names, rows, groups, strict=True):
            print(f"{name:<20} " + " ".join(f"{v:6.1f}" for v in row) + f" {count}")
        tables = [bench.tables[name] for name in bench.names]
        everything = np.array([score(t, np.arange(t.shape[1]) > 0) for t in tables])
        best = np.array([bound(t) for t in tables])
        for title, values in (("decided", rows), ("bound", best), ("kept", everything)):
            for part, mean in zip(("ten", "others"), bench.means(values), strict=True):
                print(f"{f'{title}, {part}':<20} " + " ".join(f"{v:6.1f}" for v in mean))
        return
    base = bench.means(rows)
    print(
        f"default: ten J {base[0, 0]:.1f} Fu {base[0, 3]:.1f}; others J {base[1, 0]:.1f} Fu {base[1, 3]:.1f}"
    )
    for name in constants():
        told = []
        for value in others(name):
            change = bench.means(bench.scores({name: value})[0]) - base
            told.append(f"{value:g}: {change[0, 3]:+.1f} {change[1, 3]:+.1f}")
        print(f"{name:<22} {defaults()[name]:<6g} " + "   ".join(told), flush=True)


if __name__ == "__main__":
    main()
