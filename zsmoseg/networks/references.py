"""References that are pinned: where a model lies, and the digest that it must have there.

Settings carry them from the plan to the workers; in keys the digest alone counts.
"""

from __future__ import annotations

from pathlib import Path

from zsmoseg.errors import ModelError
from zsmoseg.networks.contract import Contract, load_contract

PIN = "@sha256:"
"""Between the folder and the digest."""


def pinned(contract: Contract) -> str:
    """The reference to just this model."""
    return f"{contract.folder.absolute()}{PIN}{contract.digest}"


def is_pinned(reference: str) -> bool:
    """Whether it is more than a name or a folder."""
    return PIN in reference


def digest_of(reference: str) -> str:
    """The digest of a pinned reference; what is not pinned is itself."""
    return reference.rpartition(PIN)[2]


def contract_at(reference: str) -> Contract:
    """The contract of a pinned reference.

    Raises
    ------
    ModelError
        The model is no longer there, or no longer the one that was planned with.
    """
    contract = load_contract(Path(reference.rpartition(PIN)[0]))
    if contract.digest != digest_of(reference):
        raise ModelError(
            f"{contract.folder}: is another model than when the run was planned; start the run again"
        )
    return contract


def in_words(value: object) -> object:
    """A setting as people read it: of a pinned reference the folder's name and the front of the digest."""
    if not isinstance(value, str) or not is_pinned(value):
        return value
    folder, _, digest = value.rpartition(PIN)
    return f"{Path(folder).name} ({digest[:8]})"
