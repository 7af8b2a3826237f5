"""The text of a contract as the registry handles it: which files it names, and digests written into it.

What the contract means is read in ``zsmoseg/networks``; here it is only a TOML file with tables that name
files, so that a download can be checked and noted without knowing the task.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import NAME, File, contract_of

PICKLES = (".pt", ".pth", ".pkl", ".pickle", ".ckpt", ".tar", ".joblib")
"""Endings of files that Python objects may hide in; loading one can run code."""


def read_contract(folder: Path) -> str:
    """The text of the contract in a folder.

    Raises
    ------
    ModelError
        There is none, or it is no text.
    """
    try:
        return (folder / NAME).read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ModelError(
            f"{folder}: has no {NAME}; a model is a folder of ONNX files and {NAME} (docs/models.md)"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{folder / NAME}: cannot be read ({error})") from error


def parse(text: str, folder: Path) -> dict[str, Any]:
    """The tables of a contract.

    Raises
    ------
    ModelError
        The text is no TOML.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ModelError(f"{folder / NAME}: is not TOML ({error})") from error


def files_of(tables: Mapping[str, Any], folder: Path) -> list[File]:
    """Every file that a contract names, in its order; sha256 is empty and bytes None where they are not stated.

    Raises
    ------
    ModelError
        The contract is wrong; a name leaves the folder, is used twice, or may hold Python objects.
    """
    found = contract_of(tables, folder).files
    names = [plain_file(f.file, folder) for f in found]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ModelError(
            f"{folder / NAME}: names {', '.join(sorted(twice))} twice; every table needs a file of its own"
        )
    return found


def plain_file(name: str, folder: Path) -> str:
    """A file name that stays in its folder and is none of the kinds that may run code.

    Raises
    ------
    ModelError
        It does not.
    """
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._+-]*", name) or name == NAME:
        raise ModelError(
            f"{folder / NAME}: file {name!r} is refused; give the plain name of a file beside it"
        )
    if name.lower().endswith(PICKLES):
        raise ModelError(
            f"{folder / NAME}: {name} may hold Python objects, which run code when loaded; give ONNX files "
            "(zsmoseg models export makes them)"
        )
    return name


def refuse_pickle(path: Path) -> None:
    """Refuse a file called ``.onnx`` that is a pickle or an archive (as PyTorch's checkpoints are).

    Raises
    ------
    ModelError
        It is.
    """
    with path.open("rb") as file:
        start = file.read(4)
    if path.suffix == ".onnx" and (start[:2] == b"PK" or (start[:1] == b"\x80" and start[1:2] <= b"\x05")):
        raise ModelError(f"{path}: is no ONNX file but a pickle or an archive; it was not opened")


def sha256_of(path: Path) -> str:
    """Digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def with_digests(text: str, known: Mapping[str, tuple[str, int]], folder: Path) -> str:
    """The contract with sha256 and bytes of files that it has none for; comments stay.

    Raises
    ------
    ModelError
        A table is written in a way that nothing can be put into: its ``file`` has no line of its own.
    """
    have = {f.file: f for f in files_of(parse(text, folder), folder)}
    for name, (digest, size) in known.items():
        lines = [] if have[name].sha256 else [f'sha256 = "{digest}"']
        lines += [] if have[name].bytes else [f"bytes = {size}"]
        line = re.compile(rf'^([ \t]*)file[ \t]*=[ \t]*["\']{re.escape(name)}["\'].*$', re.MULTILINE)
        if lines and (match := line.search(text)):
            text = "\n".join([text[: match.end()], *(match[1] + new for new in lines)]) + text[match.end() :]
    after = {f.file: (f.sha256, f.bytes) for f in files_of(parse(text, folder), folder)}
    for name, (digest, size) in known.items():
        if after[name] != (digest, size):
            raise ModelError(
                f'{folder / NAME}: write sha256 = "{digest}" and bytes = {size} beside file = "{name}"'
            )
    return text
