"""Where models lie: one folder a model, with ``contract.toml`` and its ONNX files, in one cache folder."""

from __future__ import annotations

import os
import re
from difflib import get_close_matches
from pathlib import Path

from platformdirs import user_cache_path

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME
from zsmoseg.workflows.models.catalogue import Entry, entries
from zsmoseg.workflows.models.contract_text import files_of, parse, read_contract

LIKE = 0.5
"""Similarity (difflib, 0 to 1) from which a known name is offered for one that is unknown."""


def models_folder() -> Path:
    """The cache: ``$ZSMOSEG_MODELS``, or ``zsmoseg/models`` where the platform keeps caches."""
    if os.environ.get("ZSMOSEG_MODELS"):
        return Path(os.environ["ZSMOSEG_MODELS"]).expanduser()
    return user_cache_path("zsmoseg") / "models"


def plain_name(name: str) -> str:
    """A name that is one folder of the cache and nothing else.

    Raises
    ------
    ModelError
        It has separators, starts with a dot or is empty.
    """
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._+-]*", name):
        raise ModelError(f"model {name!r}: a name has letters, digits, . _ + - and starts with none of . + -")
    return name


def find_model(name: str) -> Path:
    """The folder of a model: a path to one, or a name in the cache.

    Raises
    ------
    ModelError
        It is not there; says which command gets it, its size and its licence.
    """
    path = Path(name).expanduser()
    if os.sep in name or name.startswith((".", "~")):
        read_contract(path)
        return path
    cached = models_folder() / plain_name(name)
    if (cached / NAME).is_file():
        return cached
    if (path / NAME).is_file():
        return path
    raise ModelError(missing(name))


def missing(name: str) -> str:
    """What to say of a model that is not in the cache."""
    entry = entries().get(name)
    if entry is not None:
        return f"model {name} is not here ({entry.about()}); get it with: {entry.command()}"
    near = get_close_matches(name, [*entries(), *cached_names()], 1, LIKE)
    hint = f"; did you mean {near[0]}?" if near else "; see zsmoseg models list"
    return (
        f"model {name} is unknown{hint}. Your own: zsmoseg models add FOLDER, or give the path of its folder"
    )


def known_entry(name: str) -> Entry:
    """An entry of the registry.

    Raises
    ------
    ModelError
        No entry has the name.
    """
    if name not in entries():
        raise ModelError(missing(plain_name(name)))
    return entries()[name]


def cached_names() -> list[str]:
    """The models in the cache, sorted."""
    try:
        found = sorted(models_folder().iterdir())
    except OSError:
        return []
    return [p.name for p in found if not p.name.startswith(".") and (p / NAME).is_file()]


def state(name: str) -> str:
    """``present``, ``incomplete`` (files missing or of wrong size), ``unfinished`` download or ``missing``."""
    folder = models_folder() / name
    if (folder / NAME).is_file():
        try:
            files = files_of(parse(read_contract(folder), folder), folder)
        except ModelError:
            return "incomplete"
        sizes = {f.file: (folder / f.file).stat().st_size for f in files if (folder / f.file).is_file()}
        whole = all(f.file in sizes and f.bytes in (None, sizes[f.file]) for f in files)
        return "present" if whole else "incomplete"
    here = staging(folder)
    return "unfinished" if here.is_dir() and any(p.name[0] != "." for p in here.iterdir()) else "missing"


def staging(target: Path) -> Path:
    """Where a model is put together before it is moved to its place."""
    return target.with_name(f".{target.name}.unfinished")
