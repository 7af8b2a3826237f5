"""The table of ``zsmoseg models list``: the registry, and what else lies in the cache."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import TASKS
from zsmoseg.workflows.models.catalogue import Entry, entries, licence_words, size_words
from zsmoseg.workflows.models.contract_text import files_of, parse, read_contract
from zsmoseg.workflows.models.place import cached_names, models_folder, state


@dataclass(frozen=True)
class Row:
    """One model.

    Attributes
    ----------
    name, task, size, licence, state
        As shown; ``state`` is present, incomplete, unfinished, missing or, where ``fetch`` has no pinned
        address, export only or fetch --from.
    facts
        The same for programs: bytes (or None), commercial (or None), where it is, the command that gets it.
    """

    name: str
    task: str
    size: str
    licence: str
    state: str
    facts: Mapping[str, Any]


def rows() -> list[Row]:
    """Every model of the registry and of the cache, by task and name."""
    names = {*entries(), *cached_names()}
    return sorted((_row(name) for name in names), key=lambda row: (row.task, row.name))


def _row(name: str) -> Row:
    entry, found, folder = entries().get(name), state(name), models_folder() / name
    here = found in ("present", "incomplete")
    tables, size = _cached(folder) if here else ({}, None)
    words = size_words(size)
    if entry is not None and not tables:
        tables, size, words = entry.tables, entry.size, entry.size_words()
    task = str(tables.get("task", "?"))
    facts = {
        "bytes": size,
        "commercial": tables.get("commercial"),
        "folder": str(folder) if here else None,
        "command": None if here or entry is None else entry.command(),
    }
    how = found if entry is None or found != "missing" else _how(entry)
    return Row(name, TASKS.get(task, task), words, licence_words(tables), how, facts)


def _cached(folder: Path) -> tuple[Mapping[str, Any], int | None]:
    """The contract in the cache and the bytes of its files; nothing where it cannot be read."""
    try:
        tables = parse(read_contract(folder), folder)
        return tables, sum(f.bytes or 0 for f in files_of(tables, folder))
    except ModelError:
        return {}, None


def _how(entry: Entry) -> str:
    """``missing``, or how to get it where a plain ``fetch`` cannot."""
    return "missing" if entry.public else "fetch --from" if entry.base else "export only"


def as_json(found: Sequence[Row]) -> str:
    """A list of objects."""
    return json.dumps(
        [{"name": r.name, "task": r.task, "licence": r.licence, "state": r.state, **r.facts} for r in found],
        indent=1,
    )
