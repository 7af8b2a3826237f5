"""The settings of one video, with every ``auto`` source decided by what is brought for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from zsmoseg.errors import FormatError, SettingsError, StoreError
from zsmoseg.formats.mask_formats import open_masks
from zsmoseg.formats.names import find_for_video
from zsmoseg.remote.url import is_url
from zsmoseg.settings import Settings
from zsmoseg.stores.imports import Brought, Imports
from zsmoseg.stores.location import Store
from zsmoseg.workflows.imports.fingerprints import fingerprint
from zsmoseg.workflows.planning.chosen_models import with_models

KINDS = {"proposals": "embedded", "flow": "dis", "depth": "constant"}
"""What can be brought, and what ``auto`` means without an import."""


def settle(
    settings: Settings, store: Store, name: str, before: Imports, alone: bool = True
) -> tuple[Settings, dict[str, Brought]]:
    """The settings for one video, with every ``auto`` source decided, and what is brought.

    Files of one video are no files of several: unless the video is ``alone``, a path must hold something for it.

    Raises
    ------
    SettingsError
        A path whose source says otherwise; ``imported`` where nothing was; depth without the word for it.
    FormatError
        Nothing for this video at the path.
    StoreError
        What was imported is not known any more, and no setting says what else is meant.
    """
    _refuse_urls(settings)
    brought: dict[str, Brought] = {}
    update: dict[str, Any] = {}
    for kind, plain in KINDS.items():
        section = getattr(settings, kind)
        named = bool(section.model or getattr(section, "boxes", ""))
        found = None if named else _brought(section, kind, store, name, before, alone)
        if found is None:
            source = ("network" if named else plain) if section.source == "auto" else section.source
            _refuse_both(kind, section, named, source)
            update[kind] = section.model_copy(update={"source": source})
        else:
            brought[kind] = found
            told = {"kind": found.kind} if "kind" in type(section).model_fields else {}
            update[kind] = section.model_copy(update={"source": "imported", "path": found.path, **told})
    if "flow" in brought and settings.video.every != 1:
        raise SettingsError(
            f"video.every = {settings.video.every}: imported flow leads from each frame to the next; use --every 1"
        )
    depth = update["depth"].source != "constant"
    update["motion"] = settings.motion.model_copy(update={"model": settings.motion.chosen(depth)})
    return with_models(settings.model_copy(update=update)), brought


def _refuse_urls(settings: Settings) -> None:
    """What is brought beside the source lies on this machine; a URL is not repeated, it may hold a secret."""
    brought = {f"{kind}.path": getattr(settings, kind).path for kind in KINDS}
    for name, path in {**brought, "ignore.mask": settings.ignore.mask}.items():
        if is_url(path):
            raise SettingsError(
                f"{name}: is a URL; give a path: only sources, stores and outputs are taken by URL"
            )


def _refuse_both(kind: str, section: Any, named: bool, source: str) -> None:
    """A network that is named beside another source: one of the two is not meant."""
    if named and section.path:
        raise SettingsError(f"{kind}.path and {kind}.model are given; leave one of them out")
    if named and source != "network":
        raise SettingsError(f"{kind}.model is given but {kind}.source = {source}; leave one of them out")


def _brought(
    section: Any, kind: str, store: Store, name: str, imports: Imports, alone: bool
) -> Brought | None:
    if section.source not in ("auto", "imported"):
        if section.path:
            raise SettingsError(
                f"{kind}.path is given but {kind}.source = {section.source}; leave one of them out"
            )
        return None
    before = imports.held.get(kind)
    if not section.path:
        if kind in imports.lost:
            plain = KINDS[kind]
            raise StoreError(
                f"{imports.lost[kind]}; zsmoseg import again, or say that none are meant: --set {kind}.source={plain}"
            )
        if section.source == "imported" and before is None:
            raise SettingsError(
                f"{kind}.source = imported: nothing was imported for {name}; give --{kind} PATH, or zsmoseg import first"
            )
        return before
    if kind == "depth" and not section.kind:
        raise SettingsError(
            f"{section.path}: say what the numbers are: --depth-is depth (larger = farther), inverse-depth or disparity"
        )
    path = find_for_video(Path(section.path), name).absolute()
    if not alone and path == Path(section.path).absolute() and path.suffix != ".json":
        raise FormatError(
            f"{section.path}: holds nothing for {name}; with several videos it must hold one entry for each"
        )
    word = getattr(section, "kind", "")
    if word == "auto":
        word = "ids" if open_masks(path, name).ids else "masks"
    return Brought(str(path), fingerprint(store, path), word)
