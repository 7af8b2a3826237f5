"""A model of the user's own into the cache: its files, and its contract with the digests filled in."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME, contract_of, load_contract
from zsmoseg.workflows.models.checking import check_file
from zsmoseg.workflows.models.contract_text import (
    files_of,
    parse,
    read_contract,
    refuse_pickle,
    sha256_of,
    with_digests,
)
from zsmoseg.workflows.models.place import models_folder, plain_name
from zsmoseg.workflows.models.settling_in import put_together, settle


def add(folder: Path, name: str | None) -> tuple[Path, Mapping[str, str]]:
    """Copy a model folder into the cache, after a look at all of it.

    Parameters
    ----------
    folder
        Has ``contract.toml`` and the files that it names; others are left where they are.
    name
        The name in the cache; None: that of the contract.

    Returns
    -------
    tuple[Path, Mapping[str, str]]
        Its place, and the digests (by file) that the contract did not state.

    Raises
    ------
    ModelError
        No contract, a wrong one, a file that is missing, is no ONNX file or is not what the contract says;
        another model has the name.
    """
    text = read_contract(folder)
    files = files_of(parse(text, folder), folder)
    target = models_folder() / plain_name(name or load_contract(folder).name)
    for file in files:
        if wrong := check_file(folder / file.file, file):
            raise ModelError(wrong)
    known = {f.file: (sha256_of(folder / f.file), (folder / f.file).stat().st_size) for f in files}
    digest = contract_of(parse(with_digests(text, known, folder), folder), folder).digest
    if target.exists() and load_contract(target).digest != digest:
        raise ModelError(f"{target}: another model has this name; give --name, or remove that folder")
    with put_together(target) as work:
        for file in files:
            shutil.copyfile(folder / file.file, work / file.file)
        (work / NAME).write_text(text, encoding="utf-8")
        filled = complete(work)
        settle(work, target, [f.file for f in files])
    return target, filled


def complete(work: Path) -> Mapping[str, str]:
    """Check a model that is put together and write into its contract the digests that it does not state.

    Returns
    -------
    Mapping[str, str]
        Those digests, by file.

    Raises
    ------
    ModelError
        A file is no ONNX file, or a graph is not as the contract says.
    """
    text = read_contract(work)
    files = files_of(parse(text, work), work)
    for file in files:
        refuse_pickle(work / file.file)
    digests = {f.file: (sha256_of(work / f.file), (work / f.file).stat().st_size) for f in files}
    (work / NAME).write_text(with_digests(text, digests, work), encoding="utf-8")
    check_graphs(work)
    return {f.file: digests[f.file][0] for f in files if not f.sha256}


def check_graphs(folder: Path) -> None:
    """Open every graph once, on the CPU: it is one that ONNX Runtime loads, with the tensors of the contract.

    Raises
    ------
    ModelError
        It is not; both sides are named.
    """
    from zsmoseg.networks.session import Network

    contract = load_contract(folder)
    for graph in contract.graph:
        Network(contract, "cpu").inputs(graph)
