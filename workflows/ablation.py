"""Settings compared over one set of cached cues: the steps of the paper, and sweeps of any setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from zsmoseg.datasets import Dataset, select
from zsmoseg.errors import SettingsError, StageError
from zsmoseg.metrics.clips import SequenceScore
from zsmoseg.metrics.protocols import PROTOCOLS, Rules
from zsmoseg.remote.url import place
from zsmoseg.settings import PRESETS, resolve
from zsmoseg.stores.location import Store
from zsmoseg.workflows.evaluate.evaluation import evaluate
from zsmoseg.workflows.evaluate.predictions import Prediction
from zsmoseg.workflows.evaluate.scoreboard import Scoreboard
from zsmoseg.workflows.running.request import Failure, Request, Watcher
from zsmoseg.workflows.running.run import each_plan, found_in, run

PROTOCOL = "moving"
LAST = ("groups",)
"""Where a variant ends: nothing is painted, groups and labels are enough to score."""


@dataclass(frozen=True)
class Variant:
    """Settings by dotted name on top of the user's, and what they are called."""

    name: str
    settings: Mapping[str, Any]


def paper_steps(depth: bool) -> list[Variant]:
    """The rows of the paper's ablation, its rule to the letter, and the user's own settings.

    OC: object clusters by optical flow; depth enters with the screw model, where there is one.
    """
    core = PRESETS["paper-core"]
    with_depth = [
        Variant("OC + Depth, as printed", {**core, "motion.model": "screw-printed"}),
        Variant("OC + Depth", {**core, "motion.model": "screw"}),
    ]
    return [
        Variant("Base", {"groups.rule": "keep"}),
        Variant("OC", {**core, "motion.model": "quadratic"}),
        *(with_depth if depth else []),
        Variant("ours", {}),
    ]


def cues(request: Request) -> dict[str, str]:
    """Where proposals, flow and depth of the first video come from.

    Raises
    ------
    ZsmosegError
        It cannot be planned.
    """
    _, plan = next(each_plan(request, Store.open(request.store, create=True), found_in(request)))
    if isinstance(plan, Failure):
        raise StageError(plan.message)
    stages = plan.stages
    depth = stages["depth"].settings["depth"]["source"]
    proposals = "imported" if "proposals" in stages else "embedded"
    return {"proposals": proposals, "flow": stages["flow"].settings["flow"]["source"], "depth": depth}


def sweep(text: str) -> list[Variant]:
    """``name=a,b,...`` as a variant a value.

    Raises
    ------
    SettingsError
        It is not of that form.
    """
    from zsmoseg.settings import parse_override

    name, equals, values = text.partition("=")
    if not name.strip() or not equals or not values.strip():
        raise SettingsError(f"--sweep {text}: expected section.name=value,value,...")
    found = [parse_override(f"{name}={value.strip()}") for value in dict.fromkeys(values.split(","))]
    return [Variant(f"{name} = {value}", {name: value}) for name, value in found]


def ablate(
    request: Request,
    preset: str,
    config: Any,
    overrides: Mapping[str, Any],
    variants: Sequence[Variant],
    dataset: Dataset,
    watcher: Watcher | None = None,
) -> Scoreboard:
    """Run every variant up to ``groups`` and score it; what is cached is not computed again.

    Parameters
    ----------
    request : sources, store and where to run; its settings are replaced by those of each variant.
    preset, config, overrides : the user's settings, as ``zsmoseg.settings.resolve`` takes them.

    Raises
    ------
    SettingsError
        Of any variant, before the first is run.
    DatasetError
        A source is no sequence of the dataset.
    StageError
        A video failed.
    """
    settled = [resolve(preset, config, {**overrides, **v.settings}) for v in variants]
    rules = Rules(PROTOCOL, PROTOCOLS[PROTOCOL].void)
    methods: dict[str, dict[str, SequenceScore]] = {}
    board: Scoreboard | None = None
    for variant, settings in zip(variants, settled, strict=True):
        report = run(replace(request, settings=settings, until=LAST), watcher)
        if report.failures:
            raise StageError(next(iter(report.failures.values())))
        chosen = select(dataset, list(report.names), PROTOCOL)
        prediction = Prediction(variant.name, place(request.store), run=report.run)
        board = evaluate([prediction], dataset, chosen, rules, workers=request.workers)
        methods |= board.methods
    assert board is not None
    return replace(board, methods=methods)
