"""The proposals of what moves taken away: does something static move instead?

    python benchmarks/movers_taken_away.py DAVIS STORE...

The stores hold the sequences of DAVIS with imported proposals (see ``sensitivity.py``). Of every sequence the best choice of
objects becomes background; where any are left, nothing of them moves by itself.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from sensitivity import best_choice, overlaps

from zsmoseg.grouping.affinity import shot_affinity
from zsmoseg.grouping.core import Core
from zsmoseg.grouping.groups import group_shot
from zsmoseg.grouping.world import Pair
from zsmoseg.motion.models import MODELS
from zsmoseg.motion.residuals import pair_residuals
from zsmoseg.settings import resolve
from zsmoseg.stores.arrays import Arrays
from zsmoseg.stores.location import Store
from zsmoseg.workflows.planning.plan import VideoPlan
from zsmoseg.workflows.running.request import Request
from zsmoseg.workflows.running.run import each_plan, run
from zsmoseg.workflows.stage import working_size
from zsmoseg.workflows.stages.front_end import Labels, Objects, shots_of
from zsmoseg.workflows.stages.motion.affinity import each_pair, read_visibility
from zsmoseg.workflows.stages.motion.groups import read_colours, read_pieces
from zsmoseg.workflows.stages.motion.residuals import Residuals
from zsmoseg.workflows.stages.motion.statistics import Statistics

T = TypeVar("T", bound=Arrays)


def read(plan: VideoPlan, stage: str, kind: type[T]) -> T:
    """What a stage left."""
    artifact = plan.stages[stage].artifact
    assert artifact is not None
    return kind.read(artifact)


def still_moving(plan: VideoPlan, truth: Path) -> list[int] | None:
    """Objects that move although the movers are gone; None where no other object is left."""
    labels, statistics = read(plan, "labels", Labels), read(plan, "statistics", Statistics)
    (shot,) = shots_of(read(plan, "objects", Objects))
    core, model = resolve().parameters(Core), MODELS[plan.stages["affinity"].settings["motion"]["model"]]
    gone = best_choice(overlaps(labels, truth))
    pieces, velocity = read_pieces(statistics, shot, read_colours(statistics, len(shot.objects)))
    area = pieces.area.copy()
    area[:, 0] += area[:, gone].sum(1)
    area[:, gone] = 0
    if not area[:, 1:].any():
        return None
    pairs = []
    for p in each_pair(statistics, read(plan, "residuals", Residuals), shot):
        gram, away = p.gram.copy(), np.isin(p.ids, gone)
        gram[0] += gram[away].sum(0)
        gram[away] = 0
        pairs.append(Pair(p.pair, p.ids, gram, p.noise, pair_residuals(gram, model)))
    size, seen = (len(area) - 1, area.shape[1]), read_visibility(statistics, shot)
    found = shot_affinity(lambda: iter(pairs), size, model, core.affinity, seen)
    grid = working_size(plan.probe, resolve().frames.width)
    answer = group_shot(
        found, replace(pieces, area=area), velocity, np.arange(area.shape[1]), grid, core.groups
    )
    return np.flatnonzero(answer.group).tolist()


def main() -> None:
    """Print what still moves, and count."""
    davis, total, moving = Path(sys.argv[1]), 0, 0
    sources = [str(p) for p in sorted((davis / "JPEGImages/480p").iterdir())]
    for store in sys.argv[2:]:
        chosen = resolve(overrides={"overlay.write": False})
        request = Request(sources, Path("unused"), Path(store), chosen, "serial", until=["groups"])
        run(request)
        for _, plan in each_plan(request, Store.open(store, create=False)):
            assert isinstance(plan, VideoPlan), plan
            found = still_moving(plan, davis / "Annotations/480p" / plan.name)
            total, moving = total + (found is not None), moving + bool(found)
            if found:
                print(f"{Path(store).name} {plan.name}: {found}")
    print(f"something still moves: {moving} of {total}")


if __name__ == "__main__":
    main()
