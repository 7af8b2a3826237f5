"""Models from a checkpoint: an exporter writes graphs and contract, the cache takes them when they are whole."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.workflows.models.adding import complete
from zsmoseg.workflows.models.catalogue import entries
from zsmoseg.workflows.models.contract_text import files_of, parse, read_contract
from zsmoseg.workflows.models.place import known_entry, models_folder, plain_name
from zsmoseg.workflows.models.settling_in import put_together, settle


def make(name: str, checkpoint: Path, to: Path | None) -> Path:
    """Make a model from a checkpoint that the user has.

    Parameters
    ----------
    name
        An entry of the registry that has an exporter.
    checkpoint
        The checkpoint, as its authors publish it; read with weights only.
    to
        The model's folder; None: its place in the cache.

    Returns
    -------
    Path
        The model's folder.

    Raises
    ------
    ModelError
        Unknown name, no exporter, no PyTorch, no such checkpoint, another model in the place; the exporter
        says no. Nothing is left half made.
    """
    exporter = exporter_of(name)
    target = to or models_folder() / plain_name(name)
    if not checkpoint.exists():
        raise ModelError(f"{checkpoint}: is not there; give the checkpoint ({known_entry(name).checkpoint})")
    if target.exists():
        raise ModelError(f"{target}: is there already; remove it, or give another folder with --to")
    with put_together(target) as work:
        try:
            exporter(checkpoint, work)
        except ImportError as error:
            raise _lacking(error) from error
        complete(work)
        settle(work, target, [f.file for f in files_of(parse(read_contract(work), work), work)])
    return target


def exporter_of(name: str) -> Callable[[Path, Path], Any]:
    """What makes a model: ``(checkpoint, folder)``.

    Raises
    ------
    ModelError
        The model has none, or PyTorch is not installed.
    """
    found = known_entry(name).exporter
    if found is None:
        able = ", ".join(n for n, entry in entries().items() if entry.exporter)
        raise ModelError(f"model {name}: has no exporter; {known_entry(name).command()}. Exporters: {able}")
    try:
        function = getattr(import_module(f"zsmoseg.networks.export.{found[0]}"), found[1])
    except ImportError as error:
        raise _lacking(error) from error
    return partial(function, name=found[2])


def _lacking(error: ImportError) -> ModelError:
    return ModelError(
        f"zsmoseg models export needs PyTorch and more ({error}): pip install 'zsmoseg[export]'"
    )
