"""The models that settings name: found, checked, and pinned to what they are now."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from zsmoseg.errors import ModelError, SettingsError
from zsmoseg.networks.contract import NAME, Contract, load_contract
from zsmoseg.networks.decoders import MasksTable
from zsmoseg.networks.depth import kind_of
from zsmoseg.networks.flow import check_flow
from zsmoseg.networks.instance_masks import categories_of
from zsmoseg.networks.prompts import parse_prompt
from zsmoseg.networks.references import pinned
from zsmoseg.networks.session import verified
from zsmoseg.networks.tags import tag_thresholds
from zsmoseg.networks.text_boxes import TextTable
from zsmoseg.settings import Section, Settings
from zsmoseg.tracking.by_network import style_of
from zsmoseg.workflows.models.place import find_model
from zsmoseg.workflows.stages.proposed.naming import categories

SPAN = 10
"""Frames of a span where masks are tracked: SAM-Track looks again after as many."""
CHECKS: Mapping[str, Callable[[Contract], object]] = {
    "depth": kind_of,
    "flow": check_flow,
    "tags": tag_thresholds,
    "text-boxes": lambda contract: contract.extra("text", TextTable),
    "box-masks": lambda contract: contract.extra("masks", MasksTable),
    "instance-masks": categories_of,
    "tracker": style_of,
}
"""What else a contract must say, by task."""
SMALL = 2**23
"""Bytes up to which a file is hashed when the plan is made; all are when they are opened."""


def named(settings: Settings) -> Iterator[tuple[str, str, str]]:
    """The models that act with settled settings: section, setting, name or reference."""
    for section in type(settings).model_fields:
        values: Section = getattr(settings, section)
        for name, model in values.models().items():
            yield section, name, model


def with_models(settings: Settings) -> Settings:
    """Settled settings with every model that acts as a pinned reference, and the span decided.

    Raises
    ------
    SettingsError
        A network is asked for and not named, or the models named do not make a front end.
    ModelError
        A model is not there (the message says what gets it), not whole, or of another task.
    """
    settings = _with_tracker(settings)
    _refuse_unnamed(settings)
    if settings.tags.prompt:
        parse_prompt(settings.tags.prompt)
        settings = settings.model_copy(update={"tags": settings.tags.model_copy(update={"model": ""})})
    update: dict[str, dict[str, Any]] = {}
    contracts, acting = {}, list(named(settings))
    _refuse_missing([model for _, _, model in acting])
    for section, name, model in acting:
        contracts[section, name] = contract = _contract(section, name, model, settings)
        update.setdefault(section, {})[name] = pinned(contract)
    if settings.proposals.source == "network" and settings.looks.span == "auto":
        alone = contracts.get(("proposals", "model"))
        update.setdefault("looks", {})["span"] = 1 if alone and alone.task == "instance-masks" else SPAN
    sections = {name: getattr(settings, name).model_copy(update=values) for name, values in update.items()}
    settled = settings.model_copy(update=sections)
    _refuse_unknown(settled)
    return settled


def _with_tracker(settings: Settings) -> Settings:
    """The source of tracks, decided."""
    tracking = settings.tracking
    if tracking.model and tracking.source == "flow":
        raise SettingsError("tracking.model is given but tracking.source = flow; leave one of them out")
    source = tracking.source if tracking.source != "auto" else "network" if tracking.model else "flow"
    return settings.model_copy(update={"tracking": tracking.model_copy(update={"source": source})})


def _refuse_unknown(settings: Settings) -> None:
    """A category that is denied must be one that can be found."""
    names = {name.casefold() for name in categories(settings.proposals, settings.tags)}
    for word in settings.selection.deny:
        if word.casefold() not in names:
            near = get_close_matches(word.casefold(), names, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise SettingsError(f"selection.deny: no network of this run names {word!r}{hint}")


def _refuse_missing(models: list[str]) -> None:
    """Name all that is not here at once, with what gets it."""
    lacking = []
    for model in dict.fromkeys(models):
        try:
            find_model(model)
        except ModelError as error:
            lacking.append(str(error))
    if lacking:
        raise ModelError(" | ".join(lacking))


def _contract(section: str, name: str, model: str, settings: Settings) -> Contract:
    contract = load_contract(find_model(model))
    tasks = type(getattr(settings, section)).tasks(name)
    if contract.task not in tasks:
        raise ModelError(
            f"{contract.folder / NAME}: its task is {contract.task}; {section}.{name} takes {' or '.join(tasks)}"
        )
    for file in contract.files:
        path = contract.folder / file.file
        if not path.is_file():
            raise ModelError(
                f"{path}: is missing; the model is not whole, zsmoseg models fetch or add it again"
            )
        if file.bytes is not None and path.stat().st_size != file.bytes:
            raise ModelError(
                f"{path}: has {path.stat().st_size} bytes, its contract says {file.bytes}; get it again"
            )
        if path.stat().st_size <= SMALL:
            verified(contract.folder, file)
    if contract.task in CHECKS:
        CHECKS[contract.task](contract)
    return contract


def _refuse_unnamed(settings: Settings) -> None:
    """A network that is asked for must be named, and the networks of proposals must fit together."""
    for section in ("flow", "depth", "tracking"):
        chosen = getattr(settings, section)
        if chosen.source == "network" and not chosen.model:
            raise SettingsError(f"{section}.source = network: name the network, --set {section}.model=NAME")
    p = settings.proposals
    if p.source != "network":
        idle = {
            "tags.prompt": settings.tags.prompt,
            "tags.model": settings.tags.model,
            "proposals.masks": p.masks,
            "tracking.model": settings.tracking.model,
            "selection.deny": settings.selection.deny,
        }
        for name, value in idle.items():
            if value:
                raise SettingsError(
                    f"{name} is given and no network proposes anything; name proposals.boxes and proposals.masks, or "
                    "proposals.model, or leave it out"
                )
        return
    if not p.model and not (p.boxes and p.masks):
        raise SettingsError(
            "proposals.source = network: name one network (proposals.model), or proposals.boxes and proposals.masks"
        )
    if p.model and (p.boxes or p.masks):
        raise SettingsError(
            "proposals.model is one network alone; leave it out, or proposals.boxes and .masks"
        )
    if p.model and (settings.tags.model or settings.tags.prompt):
        raise SettingsError("tags are for proposals.boxes; proposals.model names what it was trained on")
    if p.boxes and not (settings.tags.model or settings.tags.prompt):
        raise SettingsError('proposals.boxes needs words: --prompt "person, dog", or tags.model=NAME')
