"""Whether the files of a model are those that its contract names."""

from __future__ import annotations

from pathlib import Path

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import File
from zsmoseg.workflows.models.contract_text import files_of, parse, read_contract, sha256_of


def check_file(path: Path, wanted: File) -> str | None:
    """What is wrong with a file, in words; None if nothing is."""
    if not path.is_file():
        return f"{path}: is missing"
    size = path.stat().st_size
    if wanted.bytes not in (None, size):
        return f"{path}: has {size} bytes, the contract says {wanted.bytes}"
    if wanted.sha256 and (digest := sha256_of(path)) != wanted.sha256:
        return f"{path}: has sha256 {digest}, the contract says {wanted.sha256}"
    return None


def findings(folder: Path) -> list[str]:
    """What is wrong with a model folder, a line each; every file is read."""
    try:
        files = files_of(parse(read_contract(folder), folder), folder)
    except ModelError as error:
        return [str(error)]
    unstated = [f"{folder / f.file}: the contract states no sha256" for f in files if not f.sha256]
    return [wrong for f in files if (wrong := check_file(folder / f.file, f))] + unstated
